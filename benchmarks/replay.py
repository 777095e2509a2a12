#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does today's program still answer as docs/proof-table.md says?

    benchmarks/replay.py build/release/apps/rangecal --worlds 6

draws the first worlds of every row of docs/proof-table.md again, has them diagnosed and compares with docs/proof-answers.csv. The hash of the
sources (stale.py) says that something changed; this says what it changed. --check ends with 1 if an answer that was right is wrong now.
"""
import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

from proof_page import ANSWERS, rows_printed

RIGHT = {"right name", "right set", "right"}


def answers_of(path):
    with open(path, newline="") as file:
        return {(a["row"], a["design"], a["index"], a["seed"]): a for a in csv.DictReader(file)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", help="rangecal")
    parser.add_argument("--worlds", type=int, default=6, help="of each row")
    parser.add_argument("--rows", nargs="+", metavar="ROW", help="only these")
    parser.add_argument("--check", action="store_true", help="end with 1 if an answer that was right is wrong now")
    options = parser.parse_args()
    drawn = answers_of(ANSWERS)
    same = compared = worse = better = 0
    for row, seed in ((r.name, r.seed) for r in rows_printed()):
        if options.rows and row not in options.rows:
            continue
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "answers.csv"
            subprocess.run([options.program, "prove", "--fresh", str(options.worlds), "--seed", seed, "--no-oracle",
                            "--row", row, "--csv", table], check=True, capture_output=True)
            now = answers_of(table)
        for key, answer in now.items():
            if key not in drawn:
                continue
            then = drawn[key]
            compared += 1
            if (answer["answer"], answer["class"]) == (then["answer"], then["class"]):
                same += 1
                continue
            was_right, is_right = then["class"] in RIGHT, answer["class"] in RIGHT
            worse += was_right and not is_right
            better += is_right and not was_right
            print(f"{row} {key[1]} {key[2]} ({answer['planted']}): {then['answer']} ({then['class']}) -> "
                  f"{answer['answer']} ({answer['class']})")
    print(f"{compared} worlds of docs/proof-answers.csv, {same} answered as then; of the others {better} right now that were wrong, "
          f"{worse} wrong now that were right")
    return 1 if options.check and worse else 0


if __name__ == "__main__":
    sys.exit(main())
