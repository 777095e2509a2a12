#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""docs/proof-table.md of what `rangecal prove` printed, row by row, the figures that are not met first.

    for row in ROW...; do rangecal prove --fresh 24 --seed S --no-oracle --row $row --csv proof/$row.csv > proof/$row.log; done
    benchmarks/proof_page.py proof --seed S --commit HASH > docs/proof-table.md

The answers of all worlds go to docs/proof-answers.csv.
"""
import argparse
import csv
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = "core/include core/src problems solvers/include solvers/src apps/proof"
LINE = re.compile(r"^(?P<what>\S.*?\S)\s{2,}(?P<worlds>\d+)\s+(?P<figure>\S+(?: %)?)\s.*?(?P<met>NOT MET|met)$")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the logs and tables of the rows")
    parser.add_argument("--seed", required=True)
    parser.add_argument("--commit", required=True, help="of the program that drew them")
    options = parser.parse_args()
    rows = {}
    answers = []
    for log in sorted(options.folder.glob("*.log")):
        text = log.read_text()
        if "what  " not in text:
            continue  # it was stopped
        lines = [line.rstrip() for line in text.splitlines() if LINE.match(line.rstrip())]
        seconds = re.search(r"^seconds a world.*$", text, re.M)
        fresh = re.search(r"^(\d+) fresh worlds", text, re.M)
        rows[log.stem] = (lines, seconds and seconds[0], fresh and fresh[1])
        with open(log.with_suffix(".csv"), newline="") as file:
            answers += list(csv.DictReader(file))
    def missed(item):
        return sum(line.endswith("NOT MET") for line in item[1][0])
    ordered = sorted(rows.items(), key=lambda item: (-missed(item), item[0]))
    with open(ROOT / "docs" / "proof-answers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, answers[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(answers)
    digest = subprocess.run([ROOT / "benchmarks" / "stale.py", "--hash", *SOURCES.split(), "--at", options.commit],
                            check=True, capture_output=True, text=True).stdout.strip()
    print(f"""# What came out of every row that was drawn?

Worlds of `docs/proof.md`, each row drawn once, by commit {options.commit[:12]} with a seed from that commit's hash, beside other work on two
cores; the rows with most figures that are not met first. `docs/proof-answers.csv` has every answer.

```
for row in {' '.join(sorted(rows))}; do
  rangecal prove --fresh N --seed {options.seed} --no-oracle --row $row --csv $row.csv
done
```

With 24 worlds a figure is known to some ten points: the intervals are 95 %. "Right name" and "all, and nothing else" count sets that the
recording cannot tell apart; "by single names" counts answers of one set. The noncentrality lambda is that of the likelihood-ratio test of
whoever knows the effect.

```
what                                                worlds    figure  95 % interval     at least""")
    for name, (lines, seconds, fresh) in ordered:
        print(f"--row {name} --fresh {fresh}")
        for line in lines:
            print(f"  {line}")
        if seconds:
            print(f"  {seconds}")
    print(f"""```

<!-- table: rangecal prove --fresh N --seed {options.seed} --no-oracle --row ROW; sources: {SOURCES}; hash: {digest} -->""")


if __name__ == "__main__":
    main()
