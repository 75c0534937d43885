#!/usr/bin/env bash
# Installs the Debian 12 packages that the build needs, if any is missing.
# Usage: tools/setup.sh [PACKAGE...]   further packages, such as clang-format-14 for CI
set -euo pipefail

packages=(
  g++ cmake ninja-build
  libcgal-dev libqd-dev                   # refine/
  liblmdb-dev libzstd-dev libboost-serialization-dev  # storage/
  libfmt-dev libssl-dev libhdf5-dev libdeflate-dev zlib1g-dev  # engine/
  libocct-data-exchange-dev               # tools/cad/
  libcli11-dev nlohmann-json3-dev libjs-three  # tools/
  python3-dev pybind11-dev python3-numpy  # tools/python/
  libgtest-dev libbenchmark-dev python3   # tests/
  "$@"
)

if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
  echo "locvol: this is no Debian; install by hand what is missing of: ${packages[*]}" >&2
  exit 0
fi

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
  [[ $status == installed ]] || missing+=("$package")
done
[[ ${#missing[@]} -gt 0 ]] || exit 0

as_root=(env DEBIAN_FRONTEND=noninteractive)
if [[ $EUID -ne 0 ]]; then
  if ! command -v sudo >/dev/null; then
    echo "locvol: error: as root, run: apt-get install ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo "${as_root[@]}")
fi
echo "locvol: installing ${missing[*]}" >&2
"${as_root[@]}" apt-get update -qq >&2
"${as_root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >&2
