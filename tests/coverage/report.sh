#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# report.sh BUILD: what the tests ran of core, problems and solvers since the counters in BUILD were deleted. Exit code 2 below
# 90 % of the lines.
set -euo pipefail
build=$1
root=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$build/report"
gcovr --root "$root" --object-directory "$build" "$build" \
  --filter "$root/core/" --filter "$root/problems/" --filter "$root/solvers/" \
  --exclude-throw-branches --gcov-ignore-parse-errors --sort-percentage \
  --txt "$build/report/coverage.txt" --csv "$build/report/coverage.csv" \
  --html-details "$build/report/index.html" --fail-under-line 90 && below=0 || below=$?
for folder in core problems solvers; do
  awk -F, -v folder="$folder" '$1 ~ "^"folder"/" { lines += $2; run += $3 }
    END { printf "%-9s %6d lines, %5.1f %% run\n", folder, lines, lines ? 100 * run / lines : 0 }' "$build/report/coverage.csv"
done
grep '^TOTAL' "$build/report/coverage.txt"
exit "$below"
