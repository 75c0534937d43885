#!/usr/bin/env bash
# Makes the Debian packages and looks into them. lintian judges them if it is there.
# Usage: deb_test.sh CPACK BUILD_DIRECTORY OUTPUT_DIRECTORY
set -euo pipefail
cpack=$1 build=$2 out=$3

fail() { echo "deb_test: $*" >&2; exit 1; }

rm -rf "$out"
(cd "$build" && "$cpack" -B "$out" >"$build/cpack.log" 2>&1) || { cat "$build/cpack.log"; exit 1; }
command=$(echo "$out"/locvol_*.deb) development=$(echo "$out"/liblocvol-dev_*.deb)

has_path() {
  local contents
  contents=$(dpkg-deb -c "$1")
  grep -q " \./usr/$2\$" <<<"$contents" || fail "$1 has no /usr/$2"
}
for path in bin/locvol share/man/man1/locvol.1.gz share/bash-completion/completions/locvol \
    share/zsh/vendor-completions/_locvol share/fish/vendor_completions.d/locvol.fish \
    share/doc/locvol/copyright share/doc/locvol/changelog.gz share/doc/locvol/README.md \
    share/doc/locvol/tools/tutorial.md share/doc/locvol/tools/examples/calculix/case.py \
    share/doc/locvol/tools/examples/slurm/mesh.sbatch; do
  has_path "$command" "$path"
done
for path in include/locvol/locvol.h include/locvol/engine/plan/library_options.h \
    include/locvol/storage/run_choices.h \
    lib.*/liblocvol.a lib.*/cmake/locvol/locvolConfig.cmake; do
  has_path "$development" "$path"
done
headers=$(dpkg-deb -c "$development" | grep -c '\.h$')
[[ $headers == 3 ]] || fail "$development has $headers headers: only locvol.h and what it includes are for users"

depends=$(dpkg-deb -f "$command" Depends)
for library in libc6 libboost-serialization libdeflate0 libfmt libhdf5 liblmdb0 libssl3 libzstd1 zlib1g; do
  [[ $depends == *"$library"* ]] || fail "$command does not depend on $library: $depends"
done
[[ $depends != *-dev* ]] || fail "$command depends on what only its build needs: $depends"

[[ $depends != *mpi* ]] || fail "$command depends on MPI: $depends"
if [[ -e $build/tools/locvol-mpi ]]; then
  mpi=$(echo "$out"/locvol-mpi_*.deb)
  for path in bin/locvol-mpi share/man/man1/locvol-mpi.1.gz; do
    has_path "$mpi" $path
  done
  [[ $(dpkg-deb -f "$mpi" Depends) == *openmpi-bin* ]] || fail "$mpi does not depend on openmpi-bin"
fi

if [[ -e $build/lib/locvol/locvol-cad ]]; then
  cad=$(echo "$out"/locvol-cad_*.deb)
  has_path "$cad" 'lib.*/locvol/locvol-cad'
  [[ $(dpkg-deb -f "$cad" Depends) == *libocct-data-exchange* ]] ||
    fail "$cad does not depend on OpenCASCADE"
  [[ $depends != *occt* ]] || fail "$command depends on OpenCASCADE: $depends"
  [[ $(dpkg-deb -f "$command" Suggests) == *locvol-cad* ]] || fail "$command does not suggest $cad"
fi

if [[ -e $build/tools/python/locvol ]]; then
  python=$(echo "$out"/python3-locvol_*.deb) module=lib/python3/dist-packages/locvol
  for path in "$module/__init__.py" "$module/__init__.pyi" "$module/py.typed" \
      "$module/_locvol.*.so" "$module-.*.dist-info/entry_points.txt"; do
    has_path "$python" "$path"
  done
  # What Python compiles once it is there goes with it.
  dpkg-deb -e "$python" "$out/control"
  grep -q 'py3clean -p python3-locvol' "$out/control/prerm" || fail "$python leaves what was compiled"
  dpkg-deb -x "$python" "$out/python"
  PYTHONPATH=$out/python/usr/lib/python3/dist-packages /usr/bin/python3 -B -c '
import locvol
corners = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
assert len(locvol.mesh((corners, faces), "20%").cells) > 100' ||
    fail "the packaged module of Python does not mesh"
fi

dpkg-deb -x "$command" "$out/root"
[[ $("$out/root/usr/bin/locvol" --version) == "locvol $(dpkg-deb -f "$command" Version)" ]] ||
  fail "the packaged command has another version"

# The links of the pages lead to what is installed with them. Sources are not.
documents=$out/root/usr/share/doc/locvol
num_links=0
while IFS=: read -r page link; do
  [[ $link =~ ^https?: || $link =~ ^# || $link =~ \.(h|cpp)$ ]] && continue
  num_links=$((num_links + 1))
  [[ -f $(dirname "$page")/${link%%#*} ]] || fail "the packaged $page leads to $link, which is not there"
done < <(cd "$documents" && grep -roP '\]\(\K[^)\s]+' --include='*.md' "$documents")
((num_links > 100)) || fail "the packaged pages have $num_links links to each other"

if command -v lintian >/dev/null; then
  lintian --fail-on error,warning "$command" "$development" ${python:+"$python"}
fi
