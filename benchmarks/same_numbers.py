#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Do two builds of rangecal give the same numbers?

same_numbers.py ONE OTHER

Runs both programs on the shipped recordings and compares every number of what they write: by how much it differs, relative to its
own size, or to an estimate's standard deviation or the largest number of its row where that is larger, since a number near 0 has
no size of its own. Times that a solve took are left out. Exit code 1 if anything but a number differs, or a number by more than
1e-10.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

DATA = Path(__file__).resolve().parents[1] / "notebooks_data"
LIMIT = 1e-10
TIMES = {"seconds"}
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def commands():
    """Name, arguments, file written."""
    yield "simulate", ["simulate", DATA / "scenes/field-layout.yaml", "-o", "out", "--seed", "7"], "out/observations.csv"
    for recording in ("field-layout", "2021-setting", "pairs-2016"):
        for method in ("closed-form", "approximate", "full", "marginal"):
            what = ["calibrate", DATA / recording, "--method", method, "--json", "out.json"]
            yield f"{method} {recording}", what, "out.json"
    yield "track pairs-2016", ["track", DATA / "pairs-2016/pairs.csv", "-o", "out.csv"], "out.csv"
    for folder in sorted((DATA / "concealed").iterdir()):
        if (folder / "recording.yaml").exists():
            yield f"diagnose {folder.name}", ["diagnose", folder, "--json", "out.json"], "out.json"


def difference(one, other, scale=0.0):
    """Largest relative difference of two parsed files, and where it is."""
    worst = (0.0, "")
    if isinstance(one, dict) and isinstance(other, dict):
        if one.keys() != other.keys():
            return float("inf"), "members differ"
        std = one.get("std")
        for key in one:
            if key in TIMES:
                continue
            own = abs(std) if isinstance(std, (int, float)) and key != "std" else 0.0
            size, place = difference(one[key], other[key], own)
            worst = max(worst, (size, f".{key}{place}"))
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            return float("inf"), "lengths differ"
        numbers = [abs(x) for x in one if isinstance(x, (int, float)) and not isinstance(x, bool)]
        for i, (a, b) in enumerate(zip(one, other)):  # a row's or matrix's own size, not that of its smallest number
            size, place = difference(a, b, max(numbers, default=0.0))
            worst = max(worst, (size, f"[{i}]{place}"))
    elif isinstance(one, (int, float)) and isinstance(other, (int, float)) and not isinstance(one, bool):
        if one != other:
            worst = (abs(one - other) / max(abs(one), abs(other), scale), "")
    elif one != other:
        return float("inf"), f" {one!r} {other!r}"
    return worst


def answer(program, arguments, name):
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([program, *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1) or not (Path(folder) / name).exists():
            sys.exit(f"{' '.join(map(str, arguments))}: exit code {done.returncode}: {done.stderr.strip()}")
        text = (Path(folder) / name).read_text()
    if name.endswith(".json"):
        return json.loads(text)
    rows = [line.split(",") for line in text.splitlines()]
    number = lambda field: float(field) if re.fullmatch(NUMBER, field) else field  # noqa: E731
    return [[number(field) for field in row] for row in rows]


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    one, other = (str(Path(p).resolve()) for p in sys.argv[1:])
    worst, count = 0.0, 0
    for name, arguments, written in commands():
        size, place = difference(answer(one, arguments, written), answer(other, arguments, written))
        print(f"{name:28s} {size:8.1e}  {place[:80] if size > 0.0 else 'the same bits'}")
        worst, count = max(worst, size), count + 1
    print(f"{count} runs, largest difference {worst:.1e} (limit {LIMIT:.0e})")
    return worst > LIMIT


if __name__ == "__main__":
    sys.exit(main())
