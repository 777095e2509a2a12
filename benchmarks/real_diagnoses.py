#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints the table of docs/real-data.md from the rows that `rangecal diagnose DIR... --each FOUND.db` wrote.

    rangecal diagnose $RECORDINGS/*/ --each found.db
    benchmarks/real_diagnoses.py found.db
"""
import os
import sqlite3
import sys


def millimetres(before, after):
    """A root mean square before and after, in millimetres."""
    if before is None or after is None:
        return "-"
    return f"{1e3 * before:.3g} -> {1e3 * after:.3g}"


def change(nats, std):
    """A change of the held-out NLL with its standard error."""
    if nats is None:
        return "-"
    return f"{nats:.0f}" if std is None else f"{nats:.0f} +- {std:.0f}"


def names_of(row):
    """The names; probabilities only of those that are not certain."""
    told = []
    for entry in filter(None, (row["names"] or "").split(", ")):
        if entry == "generic":  # a curve that stands for what has no name
            continue
        name, _, probability = entry.rpartition(" ")
        told.append(f"`{name or entry}`" if probability == "1.00" or not name else f"`{name}` ({probability})")
    return ", ".join(told) or "-"


def main():
    database = sqlite3.connect(sys.argv[1])
    database.row_factory = sqlite3.Row
    print("| recording | readings | verdict | names | largest without a name | held-out NLL, change | held-out RMS [mm] | s |")
    print("|---|---|---|---|---|---|---|---|")
    for row in database.execute("SELECT * FROM diagnoses ORDER BY name"):
        rest = (row["rest"] or "-").split("; ")[0].rsplit(", p", 1)[0]
        verdict = (row["verdict"] or row["reason"]).replace("_", " ")
        print(
            f"| `{os.path.basename(row['name'])}` | {row['used']} | {verdict} | {names_of(row)} | {rest} "
            f"| {change(row['heldout_change'], row['heldout_std'])} "
            f"| {millimetres(row['heldout_rms_before_m'], row['heldout_rms_after_m'])} | {row['seconds']:.0f} |"
        )


if __name__ == "__main__":
    main()
