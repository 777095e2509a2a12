#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""docs/proof-table.md, docs/proof-answers.csv and README's figures of concealed causes, of what `rangecal prove` printed; rows that are not
given stay as they are there.

    for row in ROW...; do rangecal prove --fresh 300 --seed S --no-oracle --row $row --csv drawn/$row.csv > drawn/$row.log; done
    benchmarks/proof_page.py drawn=COMMIT@S

COMMIT is that of the program that drew them, S their seed.
"""
import argparse
import csv
import math
import re
import statistics
import subprocess
from collections import Counter, namedtuple
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE, ANSWERS = ROOT / "docs" / "proof-table.md", ROOT / "docs" / "proof-answers.csv"
NO_PART = "fleet plan study recursive change tilt".split()  # of no diagnosis
SOURCES = " ".join(["core problems solvers apps/proof !core/src/io !solvers/src/diagnosis/sentence.cpp",
                    "!solvers/src/diagnosis/diagnosis_json.cpp"]
                   + [f"!solvers/{part}/{name}" for name in NO_PART for part in ("src", "include/rangecal/solvers")])
LINE = re.compile(r"^\S.*?\S\s{2,}\d+\s+\S+(?: %)?\s.*?(?:NOT MET|met)$")
LIMIT = re.compile(r"^(?P<what>.*?)(?P<gap>\s{2,})(?P<rest>\d+\s+(?P<figure>\S+)(?: %)?\s.*?"
                   r"(?:[<>]= (?P<limit>\S+)|(?P<held>95) % inside).*?(?P<missed>NOT )?(?:MET|met))$")
ASKS_FOR_NOTHING = re.compile(r">= 0 %|<= 100 %")
README = ROOT / "README.md"
IN_README = {  # lines that need other words where their row does not stand above them
    "several causes: names of nothing concealed (names)": "{row}: names of nothing (names)",
    "95 % intervals cover (intervals)": "{row}: 95 % intervals hold",
    "1500 readings: seconds, worst": "{row}: worst, seconds",
    "1500 readings: seconds, median": "{row}: median, seconds",
    "lambda 50: the same": "lambda 50: right name or twin set",
    "lambda 100 or more: wrong single name": "{row}: wrong single name",
    "experiment: shrinks to the truth": "experiment: leaves the truth alone",
    "twins that show: the set": "exact twins that show: all in one set",
}
README_SHOWS = """2 causes beside an unknown one: wrong (names)|outside the catalogue: unexplained, located|formula 10 % off: right name
2 causes: found (causes)|3 causes: found (causes)|3 causes: all, and nothing else|3 causes, outliers: found (causes)|5 causes: found (causes)
5 causes: all, and nothing else|simulation, 3 causes: found (causes)|closed loop: no mismatch|lambda 100: right name or twin set
lambda 100 or more: wrong single name|clean, any design: alarm|everyday tables: all causes, and nothing else""".replace("\n", "|").split("|")
HEAD = "what                                                worlds    figure  95 % interval     at least"

Row = namedtuple("Row", "name fresh lines seconds commit seed sources hash")
Judged = namedtuple("Judged", "line what figure missed off")  # the line as README has it; off: by how much it differs from what was asked


def rows_of(folder, commit, seed):
    """Every row that was drawn whole, and its answers."""
    digest = subprocess.run([ROOT / "benchmarks" / "stale.py", "--hash", *SOURCES.split(), "--at", commit],
                            check=True, capture_output=True, text=True).stdout.strip()
    for log in sorted(folder.glob("*.log")):
        text = log.read_text()
        if "what  " not in text:
            continue
        lines = [line.rstrip() for line in text.splitlines() if LINE.match(line.rstrip())]
        seconds = re.search(r"^seconds a world.*$", text, re.M)
        fresh = re.search(r"^(\d+) fresh worlds", text, re.M)
        with open(log.with_suffix(".csv"), newline="") as file:
            yield Row(log.stem, fresh and fresh[1], lines, seconds and seconds[0], commit[:9], seed, SOURCES, digest), list(csv.DictReader(file))


def rows_printed():
    """Those of the page as it is."""
    for section in re.split(r"^## By commit ", PAGE.read_text(), flags=re.M)[1:]:
        commit, seed = re.match(r"(\S+), seed (\d+)", section).groups()
        table = re.search(r"sources: (.*?); hash: ([0-9a-f]+) -->", section, re.S)
        for part in re.split(r"^--row ", section, flags=re.M)[1:]:
            name, fresh = re.match(r"(\S+) --fresh (\d+)", part).groups()
            indented = [line.strip() for line in part.splitlines() if line.startswith("  ")]
            yield Row(name, fresh, [line for line in indented if LINE.match(line)],
                      next((line for line in indented if line.startswith("seconds")), None), commit, seed, *table.groups())


def wilson(k, n):
    z, p = 1.959964, k / n
    middle, half = (p + z * z / (2 * n)) / (1 + z * z / n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return 100 * (middle - half), 100 * (middle + half)


def percent(k, n):
    return f"{100 * k / n:.1f}" if n else ""


def held(answers):
    """Of 95 % intervals those that hold the truth, and all."""
    return tuple(sum(int(a[of] or 0) for a in answers) for of in ("covered", "intervals"))


def by_row(answers):
    """What became of every world of a row."""
    yield ("| row | worlds | one name, right | a set, right | sets in it | in part or unexplained | not seen | wrong | "
           "95 % intervals hold | median s | worst s |")
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    wrong = Counter(a["row"] for a in answers if a["class"] in ("wrong name", "wrong set", "false alarm"))
    worlds = Counter(a["row"] for a in answers)
    for row in sorted(worlds, key=lambda r: (-wrong[r] / worlds[r], r)):
        own = [a for a in answers if a["row"] == row]
        count, n = Counter(a["class"] for a in own), len(own)
        sizes = [int(a["set_size"]) for a in own if a["class"] == "right set"]
        covered, intervals = held(own)
        seconds = [float(a["seconds"]) for a in own]
        cells = [row, str(n), percent(count["right name"] + count["quiet"], n), percent(count["right set"], n),
                 f"{statistics.mean(sizes):.1f}" if sizes else "", percent(count["unexplained"], n), percent(count["missed"], n),
                 percent(wrong[row], n), f"{percent(covered, intervals)} of {intervals}" if intervals else "",
                 f"{statistics.median(seconds):.1f}", f"{max(seconds):.1f}"]
        yield f"| {' | '.join(cells)} |"


def by_probability(answers):
    """Names by the probability that they were given, and how often these were right."""
    names = []
    for answer in answers:
        for name in filter(None, (answer.get("names") or "").split("; ")):
            _, probability, right = name.rsplit(" ", 2)
            names.append((float(probability), int(right)))
    if not names:
        return
    yield "| probability | names | mean | right [%] | 95 % interval |"
    yield "|---|---|---|---|---|"
    edges = [0.0, 0.7, 0.9, 0.97, 0.99, 0.997, 0.999, 1.01]
    for low, high in zip(edges, edges[1:]):
        inside = [n for n in names if low <= n[0] < high]
        if not inside:
            continue
        right = sum(r for _, r in inside)
        a, b = wilson(right, len(inside))
        label = f"below {high:g}" if low == 0.0 else f"{low:g} to {min(high, 1.0):g}"
        yield f"| {label} | {len(inside)} | {statistics.mean(p for p, _ in inside):.4f} | {percent(right, len(inside))} | {a:.1f} to {b:.1f} |"


def sections(rows):
    for commit, seed in sorted(sorted({(r.commit, r.seed) for r in rows}), key=lambda cs: -sum((r.commit, r.seed) == cs for r in rows)):
        own = sorted((r for r in rows if (r.commit, r.seed) == (commit, seed)),
                     key=lambda r: (-sum(line.endswith("NOT MET") for line in r.lines), r.name))
        yield f"""
## By commit {commit}, seed {seed}

```
for row in {' '.join(sorted(r.name for r in own))}; do
  rangecal prove --fresh N --seed {seed} --no-oracle --row $row --csv $row.csv
done
```

```
{HEAD}"""
        for r in own:
            yield f"--row {r.name} --fresh {r.fresh}"
            yield from (f"  {line}" for line in r.lines + ([r.seconds] if r.seconds else []))
        yield f"""```

<!-- table: rangecal prove --seed {seed} of commit {commit}; sources: {own[0].sources}; hash: {own[0].hash} -->"""


def in_readme(text, rows, answers):
    """README with these figures: what was asked and not met, worst first, and after it the rows that README shows; in words the rest."""
    judged = []
    for row in rows:
        for line in row.lines:
            match = LIMIT.match(line)
            if not match or ASKS_FOR_NOTHING.search(line):
                continue
            if what := IN_README.get(match["what"]):
                line = what.format(row=row.name).ljust(len(match["what"] + match["gap"])) + match["rest"]
            figure = float(match["figure"])
            judged.append(Judged(line, match["what"], figure, match["missed"], abs(float(match["limit"] or match["held"]) - figure)))
    missed = sorted((j for j in judged if j.missed), key=lambda j: (-j.off, j.line))
    met = []
    for what in README_SHOWS:  # of several rows the one nearest to its limit
        met += sorted((j for j in judged if j.what == what and not j.missed), key=lambda j: (j.off, j.line))[:1]
    further = len(judged) - len(missed) - len(met)
    lines = [j.line for j in missed + met]
    text = re.sub(rf"```\n{re.escape(HEAD)}.*?```", lambda _: "\n".join(["```", HEAD, *lines, "```"]), text, flags=re.S)

    nothing = [j.figure for j in judged if "of nothing concealed" in j.what and not j.what.startswith("everyday")]

    def took(row):
        seconds = [float(a["seconds"]) for a in answers if a["row"] == row]
        return statistics.median_high(seconds), max(seconds), len(seconds)

    drawn_by = Counter(row.commit for row in rows).most_common()
    others = [f"{', '.join(f'`{row.name}`' for row in rows if row.commit == commit)} by {commit}" for commit, _ in drawn_by[1:]]
    (covered, intervals), (large, of_large) = held(answers), held([a for a in answers if a["row"] == "large"])
    (one, worst_one, worlds_one), (five, worst_five, worlds_five) = took("speed"), took("many-5")
    for pattern, words in [
        (r"rows are by\s+commit .*?\):", f"rows are by commit {'; '.join([drawn_by[0][0], *others])}):"),
        (r"Of \d+ further lines all are met", f"Of {further} further lines all are met"),
        (r"several causes are concealed [\d.]+ to [\d.]+ % stand", f"several causes are concealed {min(nothing):.1f} to {max(nothing):.1f} % stand"),
        (r"[\d.]+ % of \d+ cases \(", f"{percent(covered, intervals)} % of {intervals} cases ("),
        (r"in [\d.]+ % of \d+ where causes are larger", f"in {percent(large, of_large)} % of {of_large} where causes are larger"),
        (r"[\d.]+ s with one cause \(median of \d+ worlds", f"{one:.2f} s with one cause (median of {worlds_one} worlds"),
        (r"[\d.]+ s: `rangecal prove --row speed`\), [\d.]+ s with five \(median of \d+, at worst [\d.]+ s",
         f"{worst_one:.1f} s: `rangecal prove --row speed`), {five:.1f} s with five (median of {worlds_five}, at worst {worst_five:.0f} s"),
    ]:
        text, found = re.subn(pattern, words, text)
        assert found == 1, f"README does not say once: {pattern}"
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", metavar="FOLDER=COMMIT@SEED", help="logs and tables of rows, and what drew them")
    options = parser.parse_args()
    with open(ANSWERS, newline="") as file:
        answers = list(csv.DictReader(file))
    rows = {(r.name, r.commit): r for r in rows_printed()}
    for given in options.folders:
        folder, drawn_by = given.split("=")
        for row, own in rows_of(Path(folder), *drawn_by.split("@")):
            rows = {key: r for key, r in rows.items() if r.name != row.name}
            rows[row.name, row.commit] = row
            answers = [a for a in answers if a["row"] != row.name] + own
    rows = list(rows.values())
    lines = ["""# What came out of every row that was drawn?

Worlds of `docs/proof.md`, each row drawn once, two worlds at a time on two cores. `docs/proof-answers.csv` has every answer, the misses too. The
intervals are 95 %. Rows were not all drawn beside the same other work: their seconds are not to be compared. Whether today's program still answers so is
checked by `benchmarks/replay.py build/release/apps/rangecal`, which draws the first worlds of each row again.

## What became of the worlds

In % of the worlds of a row. "One name" is an answer of one set of names, all right and nothing else (of a clean world: no mismatch); "a set" is
two to four sets that the recording cannot tell apart, the right one among them, with the mean number of sets. Beside and outside the
catalogue (`outside`, `beside-unknown`) "in part or unexplained" is what is wanted, or part of it; of `absorbed`, "not seen". Rows with the
largest share of wrong answers come first.
"""]
    lines += list(by_row(answers))
    probabilities = list(by_probability(answers))
    if probabilities:
        drawn = sorted({a["row"] for a in answers if a.get("names")})
        lines += [f"""
## Are the probabilities of names what they say?

All names given in the worlds of {', '.join(f'`{r}`' for r in drawn)}. A name counts as right if what was concealed is in the class that the
probability is of: the name, its exact twins, and what replaces it in a set that the recording cannot tell apart.
"""] + probabilities
    text = "\n".join(lines + list(sections(rows))) + "\n"
    readme = in_readme(README.read_text(), rows, answers)
    PAGE.write_text(text)
    README.write_text(readme)
    fields = list(dict.fromkeys(key for answer in answers for key in answer))
    with open(ANSWERS, "w", newline="") as file:
        writer = csv.DictWriter(file, fields, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(answers)


if __name__ == "__main__":
    main()
