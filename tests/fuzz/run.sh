#!/usr/bin/env bash
# run.sh BUILD SECONDS [JOBS] [READER...]: every reader for so many seconds, JOBS at a time, from seeds made of the shipped
# files and of the inputs kept in tests/data/hostile. A finding is left in BUILD/fuzz/findings, and the run fails.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
build=$(cd "$1" && pwd)
seconds=$2
jobs=${3:-$(nproc)}
work="$build/fuzz"
mkdir -p "$work/findings"
"$here/make_seeds.py" "$build" "$work/seeds"
if [ $# -gt 3 ]; then readers=("${@:4}"); else mapfile -t readers < <(ls "$work/seeds"); fi

fuzz() {
  local reader=$1
  mkdir -p "$work/corpus/$reader" "$work/log"
  local folders=("$work/corpus/$reader" "$work/seeds/$reader")
  [ -d "$here/../data/hostile/$reader" ] && folders+=("$here/../data/hostile/$reader")
  ln -sf "$build/tests/fuzz/fuzz-readers" "$work/fuzz-$reader"
  if "$work/fuzz-$reader" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=65536 -print_final_stats=1 \
       -dict="$here/words.dict" -artifact_prefix="$work/findings/$reader-" "${folders[@]}" > "$work/log/$reader" 2>&1; then
    awk -v reader="$reader" '/stat::number_of_executed_units/ {n = $2} /stat::peak_rss_mb/ {m = $2} /cov: / {for (i = 1; i < NF; ++i) if ($i == "cov:") c = $(i + 1)}
         END {printf "%-12s %9d inputs, %5d edges, at most %4d MB: nothing found\n", reader, n, c, m}' "$work/log/$reader"
  else
    echo "$reader: FOUND, see $work/log/$reader"
    tail -40 "$work/log/$reader"
    return 1
  fi
}
export -f fuzz
export here build seconds work
printf '%s\n' "${readers[@]}" | xargs -P "$jobs" -I{} bash -c 'fuzz {}'
