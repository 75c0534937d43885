#!/usr/bin/env bash
# Makes Debian packages in build/packages: locvol, the command; liblocvol-dev, the library;
# python3-locvol, Python's package; where there is MPI locvol-mpi; where there is OpenCASCADE
# locvol-cad.
# Usage: tools/package.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

tools/setup.sh dpkg-dev file
tools/build.sh release locvol_installed
log=$PWD/build/release/cpack.log
(cd build/release && cpack -B ../packages >"$log" 2>&1) || {
  cat "$log" >&2
  echo "locvol: error: cpack failed; its output is in $log" >&2
  exit 1
}
ls build/packages/*.deb
