#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compares rangecal with other programs on the same data in one run: run.py PEERS_COMPILED [--cap SECONDS] [--quick].

For each size the data of several sets are drawn, every method solves them in a process of its own, and peers_compiled judges
all answers by one likelihood and one bound. A method that takes longer than the cap on its first set is stopped, and left out
of the larger sizes. See README.md beside this file."""
import argparse
import datetime
import os
import pathlib
import shutil
import statistics
import subprocess
import tempfile

HERE = pathlib.Path(__file__).parent
NAMES = {
    "rangecal": "rangecal",
    "rangecal_1_thread": "rangecal, 1 thread",
    "ceres": "Ceres, plain program",
    "nlopt": "NLopt, L-BFGS",
    "scipy_least_squares": "SciPy, least_squares",
    "scipy_bfgs": "SciPy, minimize BFGS",
    "scipy_trust": "SciPy, minimize trust-exact",
    "scipy_lbfgs": "SciPy, minimize L-BFGS-B",
    "nlme_gls": "R, nlme::gls",
    "nlme_gnls": "R, nlme::gnls",
    "r_optim": "R, optim BFGS",
    "octave_fminunc": "Octave, fminunc",
}
SIZES = {  # size: sets
    "pairs": {100: 100, 1000: 50, 10000: 10, 100000: 3, 1000000: 1},
    "joint": {20: 20, 100: 10, 1000: 3, 10000: 1, 100000: 1},
}
METHODS = {
    "pairs": ["rangecal", "rangecal_1_thread", "ceres", "nlopt", "scipy_least_squares", "scipy_bfgs", "scipy_trust",
              "nlme_gls", "nlme_gnls", "octave_fminunc"],
    "joint": ["rangecal", "rangecal_1_thread", "ceres", "scipy_least_squares", "scipy_lbfgs", "r_optim",
              "octave_fminunc"],
}


def command(compiled, method, arguments):
    if method.startswith("scipy"):
        return ["/usr/bin/python3", str(HERE / "scipy_peer.py"), *arguments]
    if method.startswith(("nlme", "r_")):
        return ["Rscript", str(HERE / "r_peer.R"), *arguments]
    if method.startswith("octave"):
        return ["octave-cli", "--quiet", "--norc", str(HERE / "octave_peer.m"), *arguments]
    kind, size, sets, folder, name, cap = arguments
    return [compiled, "solve", kind, size, sets, folder, name, cap]


def solve(compiled, kind, size, sets, folder, method, cap):
    """(median seconds over the sets, megabytes), or None where the cap passes before the first answer."""
    arguments = [kind, str(size), str(sets), folder, method, str(cap)]
    # Starting up and reading the data are not the solve; plain Ceres, which all ratios refer to, tunes its tolerance first.
    limit = 2.0 * cap + 10.0 if method != "ceres" else 20.0 * cap
    environment = dict(os.environ, OMP_NUM_THREADS="1") if method.endswith("1_thread") else os.environ
    with subprocess.Popen(command(compiled, method, arguments), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                          env=environment) as process:
        try:
            out, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            process.kill()
            out, _ = process.communicate()
    rows = [line.split() for line in out.splitlines() if line.count(" ") == 2]
    if not rows:
        return None
    return statistics.median(float(row[1]) for row in rows), max(float(row[2]) for row in rows)


def duration(seconds):
    for unit, factor in (("us", 1e6), ("ms", 1e3)):
        if seconds * factor < 1000:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds:.3g} s"


def compare(compiled, kind, size, sets, cap, slow):
    folder = tempfile.mkdtemp(prefix="peers-")
    subprocess.run([compiled, "make", kind, str(size), str(sets), folder], check=True)
    measured = {}
    for method in METHODS[kind]:
        if method not in slow:
            measured[method] = solve(compiled, kind, size, sets, folder, method, cap)
    out = subprocess.run([compiled, "score", kind, str(size), str(sets), folder, *METHODS[kind]], check=True,
                         stdout=subprocess.PIPE, text=True).stdout
    shutil.rmtree(folder)
    scores = {line.split()[0]: line.split()[1:] for line in out.splitlines()}
    what = f"N = {size} readings" if kind == "pairs" else f"K = {size} stops"
    print(f"\n{kind}, {what}, up to {sets} sets")
    print(f"{'':<28} {'time':>9} {'x ours':>8} {'MB':>8} {'NLL above':>10} {'optimum':>8} {'RMSE/bound':>11} {'failed':>7}")
    ours = measured["rangecal"][0]
    for method in METHODS[kind]:
        if method in slow:
            print(f"{NAMES[method]:<28} over {cap:g} s at {slow[method]} already")
            continue
        if measured[method] is None or method not in scores:
            slow[method] = size
            print(f"{NAMES[method]:<28} over {cap:g} s")
            continue
        seconds, megabytes = measured[method]
        if seconds > cap and method != "ceres":
            slow[method] = size
        runs, answers, at_optimum, above, rmse = scores[method]
        print(f"{NAMES[method]:<28} {duration(seconds):>9} {seconds / ours:>8.3g} {megabytes:>8.1f} {float(above):>10.1e} "
              f"{at_optimum + '/' + runs:>8} {float(rmse):>11.3f} {int(runs) - int(answers):>7}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("compiled")
    parser.add_argument("--cap", type=float, default=10.0, help="seconds a method gets per size")
    parser.add_argument("--quick", action="store_true", help="the two smallest sizes only")
    options = parser.parse_args()
    compiled = os.path.abspath(options.compiled)
    with open("/proc/cpuinfo") as info:
        model = next(line.split(":")[1].strip() for line in info if line.startswith("model name"))
    print(f"{datetime.date.today()}, {len(os.sched_getaffinity(0))} cores of {model}, load {os.getloadavg()[0]:.1f} before")
    for kind, sizes in SIZES.items():
        slow = {}
        for size, sets in list(sizes.items())[: 2 if options.quick else None]:
            compare(compiled, kind, size, sets, options.cap, slow)


main()
