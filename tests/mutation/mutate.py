#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Does a test notice when a sign, an exponent, a factor or an index of a likelihood is wrong?

mutate.py BUILD [--only TEXT] [--jobs N] [--list]

Changes one place of a likelihood at a time, compiles that file and links it, before the libraries of BUILD, with the tests of
its unit; a header is compiled with the tests that include it. A mutant is killed if it does not compile (in ten minutes), or a
test fails, crashes or runs longer than a minute. Survivors are listed; one that equivalent.txt names changes nothing that can be
observed, for the reason given there. Exit code 1 if any other survives. Nothing in the tree is written.
"""

import argparse
import concurrent.futures
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LANDMARKS, PAIRS = "tests/problems/landmarks/", "tests/problems/pairs/"
HEADERS = "problems/include/rangecal/problems/landmarks/"
# Likelihood: the tests of its unit, and which of them.
UNITS = {
    "core/src/noise.cpp": ["tests/core/noise_test.cpp"],
    "problems/src/pairs/pairs_problem.cpp": [PAIRS + "pairs_problem_test.cpp"],
    "problems/src/pairs/pairs_residual.cpp": [PAIRS + "pairs_problem_test.cpp"],
    "problems/src/pairs/noise_shape.cpp": [PAIRS + "pairs_problem_test.cpp", PAIRS + "noise_shape_test.cpp"],
    "problems/src/landmarks/joint_nll.cpp": [LANDMARKS + "joint_nll_test.cpp"],
    "problems/src/landmarks/cell_residual.cpp": [LANDMARKS + "cell_residual_test.cpp"],
    HEADERS + "range_term.hpp": [LANDMARKS + "range_term_test.cpp"],
    HEADERS + "power_law_term.hpp": [LANDMARKS + "range_term_test.cpp"],
    HEADERS + "taylor.hpp": [LANDMARKS + "range_term_test.cpp"],
    "solvers/src/marginal/laplace.cpp": ["tests/solvers/marginal/marginal_test.cpp"],
    "solvers/src/joint_ml/joint_log_det.cpp": ["tests/solvers/joint_ml/joint_system_test.cpp"],
    "solvers/src/joint_ml/joint_log_det_phi.cpp": ["tests/solvers/joint_ml/joint_system_test.cpp"],
}
FILTER = {"tests/solvers/marginal/marginal_test.cpp": "LaplaceMarginal.*"}
# Of these files only the functions named: the rest steps towards the optimum and may do so in more than one way.
FUNCTIONS = {"solvers/src/marginal/laplace.cpp": ["laplace_nll", "laplace_marginal"]}
CHANGES = [  # pattern, replacement, in what it changes
    (r"(?<= )\+(?= )", "-", "sign"),
    (r"(?<= )-(?= )", "+", "sign"),
    (r"(?<=[(\[{])-(?=[\w(])|(?<=[=,:?/*] )-(?=[\w(])|(?<=return )-(?=[\w(])", "", "sign"),
    (r"\+=", "-=", "sign"),
    (r"-=", "+=", "sign"),
    (r"(?<= )\*(?= )", "/", "exponent"),
    (r"(?<= )/(?= )", "*", "exponent"),
    (r"\*=", "/=", "exponent"),
    (r"/=", "*=", "exponent"),
    (r"\b1\.0\b", "2.0", "factor"),
    (r"\b2\.0\b", "3.0", "factor"),
    (r"\b3\.0\b", "2.0", "factor"),
    (r"\b4\.0\b", "3.0", "factor"),
    (r"\b6\.0\b", "5.0", "factor"),
    (r"\b0\.5\b", "1.0", "factor"),
    (r"\[0\]", "[1]", "index"),
    (r"\[1\]", "[0]", "index"),
    (r"\[2\]", "[1]", "index"),
    (r"\[3\]", "[2]", "index"),
    (r"\[([a-z])\]", r"[\1 ? \1 - 1 : 0]", "index"),
    (r"(?<=\w)\(([a-z]), ([a-z])\)", r"(\2, \1)", "index"),
    (r"\.x\(\)", ".y()", "index"),
    (r"\.y\(\)", ".x()", "index"),
    (r"\bx_m\b", "y_m", "index"),
    (r"\by_m\b", "x_m", "index"),
]
NO_LIKELIHOOD = re.compile(r"^\s*(//|#|template|static_assert|throw|constexpr int)|\boperator\b|fmt::|InputError|fill_n")
FLAGS = ["-std=c++20", "-O0", "-w", "-D_GLIBCXX_ASSERTIONS", "-isystem", "/usr/include/eigen3"]
FLAGS += [f"-I{ROOT / part}" for part in ("core/include", "problems/include", "solvers/include", "tests", "core/src", "problems/src", "solvers/src")]
LIBRARIES = ["-lceres", "-lglog", "-lnlopt_cxx", "-ltbb", "-lfmt", "-lyaml-cpp", "-lcsv", "-lgmock", "-lgtest", "-lgtest_main"]


def run(*command, timeout=600):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout, text=True)


def mutants(path):
    """Line, kind, line before and after, text of the file."""
    lines = (ROOT / path).read_text().splitlines(keepends=True)
    inside = not FUNCTIONS.get(path)
    for number, line in enumerate(lines):
        if path in FUNCTIONS and re.match(r"\w.*\(", line):
            inside = any(f" {name}(" in line for name in FUNCTIONS[path])
        code = line.split("//")[0]
        if not inside or NO_LIKELIHOOD.search(line):
            continue
        for pattern, replacement, kind in CHANGES:
            for match in re.finditer(pattern, code):
                changed = code[:match.start()] + match.expand(replacement) + code[match.end():] + line[len(code):]
                yield number + 1, kind, line.strip(), changed.strip(), "".join(lines[:number] + [changed] + lines[number + 1:])


class Bench:
    """The tests' objects, and what links them."""

    def __init__(self, build, work):
        self.work = work
        self.libraries = [str(build / part / f"librangecal_{part}.a") for part in ("solvers", "problems", "core")]
        (work / "common.hpp").write_text("#include <gtest/gtest.h>\n#include <Eigen/Dense>\n#include <algorithm>\n#include <cmath>\n")
        self.flags = [*FLAGS, "-include", str(work / "common.hpp")]
        must(run("c++", *FLAGS, "-x", "c++-header", work / "common.hpp", "-o", work / "common.hpp.gch"))

    def test_objects(self, path):
        objects = []
        for test in UNITS[path]:
            objects.append(self.work / (Path(test).stem + ".o"))
            if not objects[-1].exists():
                must(run("c++", *self.flags, "-c", ROOT / test, "-o", objects[-1]))
        return objects

    def passes(self, path, text):
        """Whether the tests of `path` pass with this text in its place."""
        with tempfile.TemporaryDirectory(dir=self.work) as folder:
            folder = Path(folder)
            if path.endswith(".hpp"):
                header = folder / path.split("include/")[1]
                header.parent.mkdir(parents=True)
                header.write_text(text)
                compiled, objects = [ROOT / test for test in UNITS[path]], []
            else:
                (folder / "mutant.cpp").write_text(text)
                compiled, objects = [folder / "mutant.cpp"], self.test_objects(path)
            flags = self.flags + [f"-I{(ROOT / path).parent}"]
            names = FILTER.get(UNITS[path][0], "*")
            try:
                if run("c++", f"-I{folder}", *flags, *compiled, *objects, *self.libraries, *LIBRARIES, "-o", folder / "test").returncode:
                    return False
                return run(folder / "test", "--gtest_brief=1", f"--gtest_filter={names}", timeout=60).returncode == 0
            except subprocess.TimeoutExpired:
                return False


def must(done):
    if done.returncode:
        sys.exit(done.stdout[-3000:])


def main():
    options = argparse.ArgumentParser()
    options.add_argument("build", type=Path)
    options.add_argument("--only", default="", help="likelihoods whose path holds this")
    options.add_argument("--jobs", type=int, default=1)
    options.add_argument("--list", action="store_true", help="count the mutants and stop")
    options = options.parse_args()
    paths = [path for path in UNITS if options.only in path]
    if options.list:
        for path in paths:
            print(f"{path}: {len(list(mutants(path)))} mutants")
        return 0
    known = {}
    for line in (Path(__file__).parent / "equivalent.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            path, changed, why = line.split(" | ")
            known[path, changed] = why
    total = 0
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        bench = Bench(options.build.resolve(), Path(folder))
        for path in paths:
            if not bench.passes(path, (ROOT / path).read_text()):
                sys.exit(f"{path}: its tests do not pass as it is")
            chosen = list(mutants(path))
            alive = pool.map(lambda mutant: bench.passes(path, mutant[4]), chosen)
            survivors = [mutant for mutant, lives in zip(chosen, alive) if lives]
            silent = [mutant for mutant in survivors if (path, mutant[3]) not in known]
            total += len(silent)
            print(f"{path}: {len(chosen)} mutants, {len(chosen) - len(survivors)} killed, "
                  f"{len(survivors) - len(silent)} equivalent, {len(silent)} survived", flush=True)
            for number, kind, line, changed, _ in silent:
                print(f"  row {number}, {kind}\n    - {line}\n    + {changed}", flush=True)
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
