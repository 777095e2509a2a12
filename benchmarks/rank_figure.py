#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws what rank_study wrote: for each reported number the ranks' distribution less the uniform one, a line for each setting.

usage: rank_figure.py RANKS.csv FIGURE [WHO...]      WHO: those whose reports are drawn (calibrate, correct, track); all by default
Needs matplotlib and SciPy (Debian: python3-matplotlib, python3-scipy).
"""
import csv
import sys
from collections import defaultdict

import matplotlib
import numpy as np
from scipy.stats import beta, binom

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def band(n, levels, samples=2000):
    """Half of the simultaneous 95 % band of n uniform ranks' distribution at these levels, above and below the uniform one."""
    draws = np.sort(np.random.default_rng(1).uniform(size=(samples, n)), axis=1)
    i = np.arange(1, n + 1)
    below = beta.cdf(draws, i, n + 1 - i)
    local = np.quantile(np.min(2 * np.minimum(below, 1 - below), axis=1), 0.05)  # the local level that 5 % fall below
    return binom.ppf(local / 2, n, levels) / n - levels, binom.ppf(1 - local / 2, n, levels) / n - levels


def main():
    source, target, *who = sys.argv[1:]
    lines, worlds = defaultdict(lambda: defaultdict(list)), 0
    with open(source, newline="") as file:
        for row in csv.DictReader(file):
            if who and row["parameter"].split(":")[0] not in who:
                continue
            lines[row["parameter"]][row["setting"]].append((float(row["level"]), float(row["difference"])))
            worlds = max(worlds, int(row["worlds"]))
    levels = np.arange(1, 100) / 100
    low, high = band(worlds, levels)
    columns = 4
    figure, axes = plt.subplots(-(-len(lines) // columns), columns, figsize=(10, 1.9 * -(-len(lines) // columns)),
                                sharex=True, sharey=True, squeeze=False)
    for axis, (parameter, settings) in zip(axes.flat, sorted(lines.items())):
        axis.fill_between(levels, low, high, color="0.85", lw=0)
        for points in settings.values():
            axis.plot(*zip(*points), color="C0", lw=0.5, alpha=0.6)
        axis.set_title(parameter, fontsize=8)
        axis.tick_params(labelsize=7)
    for axis in list(axes.flat)[len(lines):]:
        axis.set_visible(False)
    figure.supxlabel("level", fontsize=8)
    figure.supylabel("share of ranks below it, less the level", fontsize=8)
    figure.tight_layout()
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main()
