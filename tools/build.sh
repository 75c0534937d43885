#!/usr/bin/env bash
# Builds targets of a build tree with Ninja; quiet unless it fails. Configures the tree first if it
# is new, or if CMake options are given.
# Usage: tools/build.sh TREE [-DOPTION=VALUE...] [TARGET...]   TREE is build/TREE
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

tree=build/$1
shift
options=()
while [[ ${1:-} == -D* ]]; do
  options+=("$1")
  shift
done

mkdir -p "$tree"
log=$tree/build.log
configure_and_build() {
  if [[ ! -f $tree/build.ninja || ${#options[@]} -gt 0 ]]; then
    cmake -S . -B "$tree" -G Ninja "${options[@]}" || return
  fi
  cmake --build "$tree" --parallel "$(nproc)" ${1:+--target "$@"}
}

[[ -f $tree/build.ninja ]] || echo "locvol: building in $tree; the first time takes minutes" >&2
if ! configure_and_build "$@" >"$log" 2>&1; then
  cat "$log" >&2
  echo "locvol: error: the build failed; its output is in $log" >&2
  exit 1
fi
