#!/usr/bin/env bash
# Installs what is missing, builds all and runs the tests; ends with those that were skipped, and
# what would run them.
# Usage: tools/test.sh [ARGUMENTS OF ctest...]
#   LOCVOL_MODELS    directory of the shared models (default: ../shared/models, if it is there;
#                    without it the tests that need models are skipped)
#   LOCVOL_SANITIZE  address or thread: the sanitizer build, in build/address or build/thread
#   LOCVOL_SANITIZE_TESTS  OFF: but for what the tests themselves are, which are compiled as without
#   LOCVOL_UNITY     ON: many files are compiled as one, in half the time
#   LOCVOL_WERROR    ON: a warning is an error
#   LOCVOL_BUILD_ONLY  ON: runs none
#   LOCVOL_MAY_SKIP  a regular expression: a test skipped for another reason has failed
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

models=${LOCVOL_MODELS:-../shared/models}
[[ -d $models ]] && models=$(cd "$models" && pwd) || models=
sanitize=${LOCVOL_SANITIZE:-}
tree=${sanitize:-release}

tools/setup.sh python3-vtk9 python3-gmsh python3-meshio  # readers of the formats
tools/build.sh "$tree" "-DLOCVOL_MODELS=$models" "-DLOCVOL_SANITIZE=$sanitize" \
  "-DLOCVOL_SANITIZE_TESTS=${LOCVOL_SANITIZE_TESTS:-ON}" \
  "-DCMAKE_UNITY_BUILD=${LOCVOL_UNITY:-OFF}" "-DCMAKE_COMPILE_WARNING_AS_ERROR=${LOCVOL_WERROR:-OFF}"
[[ ${LOCVOL_BUILD_ONLY:-OFF} == ON ]] && exit
# One more than there are processors: some wait, for a disk or for what they started.
exec python3 -B tools/run_tests.py "build/$tree" \
  --output-on-failure --no-tests=error --parallel "$(($(nproc) + 1))" "$@"
