#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# run.sh BUILD: memory errors and leaks in the smoke set. One line for each program; exit code 1 if valgrind objects to any.
set -uo pipefail
build=$(cd "$1" && pwd) || exit 2
root=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 2
bad=0

# memcheck NAME COMMAND...: exit code 99 is valgrind's own, above are signals and what could not be started; what the program itself
# returns below has its tests elsewhere.
memcheck() {
  local name=$1 start=$SECONDS
  shift
  valgrind -q --error-exitcode=99 --leak-check=full --show-leak-kinds=definite --errors-for-leak-kinds=definite \
    "$@" >"$work/out" 2>"$work/err"
  local code=$?
  printf '%-12s %5d s  %s\n' "$name" $((SECONDS - start)) "$([ $code -ge 99 ] && echo "errors, exit $code" || echo "clean, exit $code")"
  if [ $code -ge 99 ]; then
    bad=1
    grep '^==' "$work/err" | head -60
  fi
}

rangecal=$build/apps/rangecal
data=$root/notebooks_data
memcheck core "$build/tests/test_core"
memcheck problems "$build/tests/test_problems"
memcheck compare "$rangecal" compare "$data/field-layout"
memcheck calibrate "$rangecal" calibrate "$data/pairs-2016" --json cal.json
printf '1.2\n2.5\nnan\n' >readings.txt
memcheck correct "$rangecal" correct cal.json <readings.txt
memcheck track "$rangecal" track "$data/pairs-2016/pairs.csv" -o distances.csv --state state.json
memcheck simulate "$rangecal" simulate "$data/scenes/field-layout.yaml" -o simulated --seed 7
memcheck diagnose "$rangecal" diagnose "$data/field-layout" --json diagnosis.json
memcheck report "$rangecal" compare "$data/field-layout" --report page.html
memcheck effects "$rangecal" effects
printf 'sensor_name: [\n' >broken.yaml
memcheck refused "$rangecal" simulate broken.yaml -o nothing
exit $bad
