#!/usr/bin/env bash
# Runs the locvol command; first installs what is missing and builds what has changed.
# Usage: tools/locvol.sh ARGUMENTS OF locvol...
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

"$root/tools/setup.sh"
"$root/tools/build.sh" release locvol
exec "$root/build/release/tools/locvol" "$@"
