#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""docs/proof-table.md of what `rangecal prove` printed, row by row, the figures that are not met first.

    for row in ROW...; do rangecal prove --fresh 24 --seed S --no-oracle --row $row --csv proof/$row.csv > proof/$row.log; done
    benchmarks/proof_page.py proof=COMMIT@S > docs/proof-table.md

COMMIT is that of the program that drew them, S their seed; rows of several programs or seeds are given as several folders. The answers of all worlds go to
docs/proof-answers.csv.
"""
import argparse
import csv
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = "core/include core/src problems solvers/include solvers/src apps/proof"
LINE = re.compile(r"^\S.*?\S\s{2,}\d+\s+\S+(?: %)?\s.*?(?:NOT MET|met)$")


def rows_of(folder):
    """(row, lines of its figures, line of its seconds, worlds asked for) of every row that was drawn whole, and all answers."""
    rows, answers = [], []
    for log in sorted(folder.glob("*.log")):
        text = log.read_text()
        if "what  " not in text:
            continue
        lines = [line.rstrip() for line in text.splitlines() if LINE.match(line.rstrip())]
        seconds = re.search(r"^seconds a world.*$", text, re.M)
        fresh = re.search(r"^(\d+) fresh worlds", text, re.M)
        rows.append((log.stem, lines, seconds and seconds[0], fresh and fresh[1]))
        with open(log.with_suffix(".csv"), newline="") as file:
            answers += list(csv.DictReader(file))
    return sorted(rows, key=lambda row: (-sum(line.endswith("NOT MET") for line in row[1]), row[0])), answers


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", metavar="FOLDER=COMMIT@SEED", help="logs and tables of rows, and what drew them")
    options = parser.parse_args()
    print("""# What came out of every row that was drawn?

Worlds of `docs/proof.md`, each row drawn once, beside other work on two cores; the rows with most figures that are not met first.
`docs/proof-answers.csv` has every answer. Seconds of different sections are not to be compared: the machines were busy. With 24 worlds
a figure is known to some ten points: the intervals are 95 %. "Right name" and "all, and nothing else" count sets that the recording cannot
tell apart; "by single names" counts answers of one set. The noncentrality lambda is that of the likelihood-ratio test of whoever knows the
effect.""")
    everything = []
    for given in options.folders:
        folder, drawn_by = given.split("=")
        commit, seed = drawn_by.split("@")
        rows, answers = rows_of(Path(folder))
        everything += answers
        digest = subprocess.run([ROOT / "benchmarks" / "stale.py", "--hash", *SOURCES.split(), "--at", commit],
                                check=True, capture_output=True, text=True).stdout.strip()
        print(f"""
## By commit {commit[:9]}, seed {seed}

```
for row in {' '.join(sorted(row[0] for row in rows))}; do
  rangecal prove --fresh N --seed {seed} --no-oracle --row $row --csv $row.csv
done
```

```
what                                                worlds    figure  95 % interval     at least""")
        for name, lines, seconds, fresh in rows:
            print(f"--row {name} --fresh {fresh}")
            for line in lines + ([seconds] if seconds else []):
                print(f"  {line}")
        print(f"""```

<!-- table: rangecal prove --seed {seed} of commit {commit[:9]}; sources: {SOURCES}; hash: {digest} -->""")
    with open(ROOT / "docs" / "proof-answers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, everything[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(everything)


if __name__ == "__main__":
    main()
