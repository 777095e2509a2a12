#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Has `rangecal diagnose` answer worlds of simulator.py, one after another, and grades the answers.

A cause counts as found if the answer, or one of up to three sets which the diagnosis says it cannot tell from it, holds one of
the names that say the cause's physics, or a name which the diagnosis lists as a twin of such a name. Of several sets the one
with most causes counts (then the one with fewest other names). `generic` is no name, but with it the answer is not
"all and nothing else". By single names: the first answer alone, no twins.
A line per world goes to the CSV; a run that was stopped goes on.
"""
import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import time

import simulator as sim

ROWS = {"clean": {}, "clean-hidden": {"hide": True}, "clean-laplace": {"core": "laplace"}, "clean-logistic": {"core": "logistic"},
        "one": {"count": 1}, "two": {"count": 2}, "three": {"count": 3}, "outside": {"count": 1, "outside": True}}
FIELDS = ["row", "world", "planted", "names", "sizes", "lambda", "lambda_beside", "verdict", "answer", "rivals", "rest", "concealed",
          "found", "single_found", "given", "wrong", "wrong_single", "all", "all_single", "alarm", "left", "seconds", "dropped", "design"]


def interval(k, n, z=1.96):
    """Wilson's 95 % interval of a share, in percent."""
    if n == 0:
        return "      -      "
    p, q = k / n, 1 + z * z / n
    mid, half = (p + z * z / (2 * n)) / q, z / q * ((p * (1 - p) + z * z / (4 * n)) / n) ** 0.5
    return "%5.1f [%4.1f, %5.1f]" % (100 * p, 100 * max(mid - half, 0), 100 * min(mid + half, 1))


def match(names, causes, twins):
    """Causes found in a set of names, and names that stand for nothing planted."""
    says = {n: {n}.union(*[g for g in twins if n in g]) for n in names}
    found = [c["cause"] for c in causes if any(says[n] & set(c["ids"]) for n in names)]
    wrong = [n for n in names if not any(says[n] & set(c["ids"]) for c in causes)]
    return found, wrong


def grade(d, causes):
    final = d.get("final", {}).get("effects", [])
    sets, rivals = [final], []
    for e in d.get("explanations", []):
        if sorted(e["effects"]) == sorted(final):
            rivals = [r if isinstance(r, list) else [r] for r in e.get("indistinguishable_from", [])][:3]
    sets += rivals
    twins = [[n for n in g if n in KNOWN] for g in d.get("twins", [])]
    plain = lambda s: [n for n in s if n != "generic"]
    scored = []
    for s in sets:
        found, wrong = match(plain(s), causes, twins)
        whole = len(found) == len(causes) and not wrong and "generic" not in s and d["verdict"] in ("explained", "no_mismatch")
        scored.append((len(found), whole, -len(wrong), s, found, wrong))
    best = max(scored, key=lambda x: x[:3])
    single = match(plain(final), causes, [])
    return {"answer": final, "rivals": rivals, "found": best[0], "wrong": best[5], "given": len(plain(best[3])), "all": best[1],
            "single_found": len(single[0]), "wrong_single": single[1],
            "all_single": len(single[0]) == len(causes) and not single[1] and "generic" not in final
            and d["verdict"] in ("explained", "no_mismatch"), "alarm": d["verdict"] not in ("no_mismatch", "unobservable")}


KNOWN = {i for c in sim.CAUSES.values() for i in c[0]} | {
    "antenna_pattern", "axial_depth", "device_offset", "dropout", "laser_pointing", "power_bias", "range_offset",
    "range_saturation", "range_scale", "scan_latency", "sweep_motion", "covariate_drift", "stop_effect"}


def world(rangecal, row, index, seed, keep):
    folder = os.path.join(keep, "%s-%d" % (row, index))
    truth = sim.make(folder, seed + 1000 * list(ROWS).index(row), index, **ROWS[row])
    answer = os.path.join(folder, "diagnosis.json")
    start = time.time()
    try:
        run = subprocess.run([rangecal, "diagnose", os.path.join(folder, "recording"), "--json", answer], capture_output=True,
                             text=True, timeout=60)
        d = json.load(open(answer)) if os.path.exists(answer) else {"verdict": "exit %d" % run.returncode}
    except subprocess.TimeoutExpired:
        d = {"verdict": "timeout"}
    g = grade(d, truth["causes"])
    left = sim.left_of(truth, sorted(set(g["answer"]))) if any(c["lambda"] for c in truth["causes"]) and not g["all"] else ""
    num = lambda key: " ".join("-" if c[key] is None else "%.3g" % c[key] for c in truth["causes"])
    return dict(g, row=row, world=index, planted=" ".join(c["cause"] for c in truth["causes"]),
                names=" ".join("|".join(c["ids"]) or "-" for c in truth["causes"]), sizes=num("size"), verdict=d["verdict"],
                rest=" ".join("%s/%s" % (r["channel"], r["covariate"]) for r in d.get("final", {}).get("rest", [])),
                concealed=len(truth["causes"]), seconds="%.1f" % (time.time() - start), dropped=" ".join(truth["dropped"]),
                answer=" ".join(g["answer"]), rivals="; ".join(" ".join(r) for r in g["rivals"]), wrong=" ".join(g["wrong"]),
                wrong_single=" ".join(g["wrong_single"]), all=int(g["all"]), all_single=int(g["all_single"]), alarm=int(g["alarm"]),
                **{"lambda": num("lambda"), "lambda_beside": num("lambda_beside")},
                left=left if left == "" else "%.1f" % left,
                design="%s K%d L%d R%d %s%s" % (truth["path"], truth["stops"], truth["landmarks"], truth["repeats"], truth["error"],
                                                "" if truth["sigma_heading_rad"] else " exact-headings"))


def table(lines):
    print("%-15s %6s  %-20s %-20s %-20s %-20s %-20s %-20s" % ("row", "worlds", "causes found %", "found, single names", "all, nothing else %",
                                                         "all, single names %", "wrong of names %", "worlds with alarm %"))
    for row in ROWS:
        x = [l for l in lines if l["row"] == row]
        if not x:
            continue
        total = lambda key: sum(int(l[key]) for l in x)
        wrong, given = sum(len(l["wrong"].split()) for l in x), total("given")
        causes = sum(int(l["concealed"]) for l in x) if row != "outside" else 0
        print("%-15s %6d  %-20s %-20s %-20s %-20s %-20s %-20s" % (
            row, len(x), interval(total("found"), causes), interval(total("single_found"), causes),
            interval(total("all"), len(x) if causes else 0), interval(total("all_single"), len(x) if causes else 0),
            interval(wrong, given) + " %d/%d" % (wrong, given), interval(total("alarm"), len(x))))
    drops = {}
    for l in lines:
        for n in l["dropped"].split():
            drops[n] = drops.get(n, 0) + 1
    print("\ndropped, out of reach of the wanted noncentrality within the sensible size or not possible in that world: %d in all" % sum(drops.values()))
    print("  " + ", ".join("%s %d" % x for x in sorted(drops.items(), key=lambda x: -x[1])))
    print("\nmisses: planted -> answer")
    for l in lines:
        bad = int(l["alarm"]) if l["row"].startswith("clean") else l["wrong"] if l["row"] == "outside" else not int(l["all"])
        if bad or l["row"] == "outside" and not int(l["alarm"]):
            print("  %s %s (%s): %s [%s] -> %s: %s%s%s" % (l["row"], l["world"], l["design"], l["planted"], l["sizes"], l["verdict"], l["answer"] or "-",
                  " | or " + l["rivals"] if l["rivals"] else "", " | rest " + l["rest"] if l["rest"] else "") + (" | left %s" % l["left"] if l["left"] else ""))


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("rangecal")
    a.add_argument("--seed", type=int, required=True)
    a.add_argument("--worlds", type=int, required=True, help="worlds per row")
    a.add_argument("--csv", required=True)
    a.add_argument("--rows", default="clean,one,two,three,outside", help=",".join(ROWS))
    a.add_argument("--keep", default="", help="keep recordings and diagnoses here")
    a = a.parse_args()
    lines = list(csv.DictReader(open(a.csv))) if os.path.exists(a.csv) else []
    done = {(l["row"], int(l["world"])) for l in lines}
    keep = a.keep or a.csv + ".tmp"
    with open(a.csv, "a", newline="") as f:
        out = csv.DictWriter(f, FIELDS)
        if not lines:
            out.writeheader()
        for row in a.rows.split(","):
            for i in range(a.worlds):
                if (row, i) not in done:
                    out.writerow(world(a.rangecal, row, i, a.seed, keep))
                    f.flush()
                    if not a.keep:
                        shutil.rmtree(keep)
    table(list(csv.DictReader(open(a.csv))))


if __name__ == "__main__":
    sys.exit(main())
