#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What `rangecal compare`, with its defaults, makes of real recordings: the table of docs/real-data.md.

  benchmarks/real_calibration.py build/release/apps/rangecal RECORDING...

Figures of the method trusted (the last one that converged). Wall time of the whole command.
"""
import re
import subprocess
import sys
import time


def row_of(text, name):
    """The cells of a table row, split at two spaces and more."""
    for line in text.splitlines():
        if line.startswith(name + "  "):
            return re.split(r"\s{2,}", line[len(name):].strip())
    return []


def main():
    program, recordings = sys.argv[1], sys.argv[2:]
    print("| recording | trusted; others that converged | shapes of range; bearing | sigma_theta [deg] | landmark RMSE [mm] "
          "| error / std | range RMSE [mm] | left out [mm] | std by stops / std | usable | s |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for recording in recordings:
        begin = time.monotonic()
        done = subprocess.run([program, "compare", recording], capture_output=True, text=True, check=False)
        seconds = time.monotonic() - begin
        text = done.stdout
        outcomes = row_of(text, "outcome")
        methods = ["closed-form", "approximate", "full", "marginal"]
        converged = [i for i, outcome in enumerate(outcomes) if outcome == "converged"]
        if not converged:
            print(f"| {recording.rstrip('/').split('/')[-1]} | none | | | | | | | | | {seconds:.1f} |")
            continue
        best = converged[-1]

        def cell(name, short=True):
            cells = row_of(text, name)
            value = cells[best] if best < len(cells) else "-"
            return value.split(" +- ")[0] if short else value

        others = ", ".join(f"{methods[i]} {row_of(text, 'landmark RMSE [mm]')[i]} mm" for i in converged[:-1]
                           if row_of(text, "landmark RMSE [mm]"))
        usable = "no" if text.startswith("WARNING: do not use") else "yes" if row_of(text, "left out, RMS [mm]") else "-"
        print(f"| {recording.rstrip('/').split('/')[-1]} | {methods[best]}; {others or '-'} "
              f"| {cell('range tails', False) if row_of(text, 'range tails') else 'gaussian'}; "
              f"{cell('bearing tails', False) if row_of(text, 'bearing tails') else 'gaussian'} "
              f"| {cell('sigma_theta [deg]')} | {cell('landmark RMSE [mm]')} | {cell('landmark error / std')} "
              f"| {cell('range RMSE [mm]', False)} | {cell('left out, RMS [mm]', False)} | {cell('std by stops / std')} "
              f"| {usable} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
