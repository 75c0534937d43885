#!/usr/bin/env bash
# Builds the fuzz targets with clang and runs each in a process of its own, from its seeds and what
# earlier runs have learned.
# Usage: tests/fuzz/run.sh MINUTES [TARGET...]     targets: surface codec store (default: all)
# Logs, corpora and findings go to build/fuzz/runs/TARGET.{log,corpus,findings}.
# The exit code tells: 0 nothing found, 1 something was.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

minutes=${1:?usage: tests/fuzz/run.sh MINUTES [TARGET...]}
shift
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || targets=(surface codec store)
tree=build/fuzz
jobs=${LOCVOL_JOBS:-$(nproc)}

[[ -n ${CXX:-} ]] || tools/setup.sh clang-16 libclang-rt-16-dev
cmake -S . -B "$tree" -G Ninja -DCMAKE_CXX_COMPILER="${CXX:-clang++-16}" -DLOCVOL_FUZZ=ON \
  -DLOCVOL_SANITIZE=address -DCMAKE_CXX_FLAGS_RELEASE="-O1 -gline-tables-only" >/dev/null
nice ninja -C "$tree" -j "$jobs" "${targets[@]/%/_fuzzer}" >&2

# A longer input is no better than a short one, only slower.
declare -A max_len=([surface]=16384 [codec]=4096 [store]=512)
# The quarantine of freed memory counts in the limit.
export ASAN_OPTIONS=quarantine_size_mb=32:detect_leaks=1
export UBSAN_OPTIONS=print_stacktrace=1

declare -A pid=()
for target in "${targets[@]}"; do
  run=$tree/runs/$target
  mkdir -p "$run.corpus" "$run.findings"
  cat tests/fuzz/dictionaries/"$target"*.dict >"$run.dict"
  nice -n 19 "$tree/tests/fuzz/${target}_fuzzer" \
    -max_total_time=$((60 * minutes)) -max_len="${max_len[$target]}" -dict="$run.dict" \
    -rss_limit_mb=512 -malloc_limit_mb=256 -timeout=60 -use_value_profile=1 \
    -artifact_prefix="$run.findings/" -print_final_stats=1 \
    "$run.corpus" "tests/fuzz/seeds/$target" >"$run.log" 2>&1 &
  pid[$target]=$!
done

status=0
for target in "${targets[@]}"; do
  if wait "${pid[$target]}"; then
    echo "$target: $(grep -E '^#[0-9]+' "$tree/runs/$target.log" | tail -n 1)"
  else
    status=1
    echo "$target: found something, see $tree/runs/$target.log and $tree/runs/$target.findings/"
  fi
done
exit "$status"
