#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""hostile.py BUILD [WORK] [--only NAME]: input of hostile size, what rangecal says to it, how long it takes and how much memory.
Every case ends by itself with one line, exit code 2 or 1 (0 where the input is merely large), below its limit of memory.
The memory of the Python that starts it, some 115 MB, counts as the least. Needs 6 GB in WORK for a while (a folder made in /tmp if none is given)."""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

GIB = 1 << 30


def write_repeated(path, block, bytes_wanted, head=b"", tail=b""):
    with open(path, "wb") as file:
        file.write(head)
        block = block * max(1, (1 << 22) // len(block))
        left = bytes_wanted
        while left > 0:
            file.write(block[: min(left, len(block))])
            left -= len(block)
        file.write(tail)


def write_rows(path, head, rows, row_of):
    """Rows in blocks of which only a number changes: 1e8 of them in a minute or two."""
    with open(path, "w") as file:
        file.write(head)
        for first in range(0, rows, 100_000):
            file.write("".join([row_of(i) for i in range(first, min(first + 100_000, rows))]))


class Bench:
    def __init__(self, build, work, only):
        self.program, self.loader = build / "apps" / "rangecal", build / "benchmarks" / "load_speed"
        self.work, self.only, self.failed = work, only, False

    def wants(self, name):
        return not self.only or self.only in name

    def run(self, name, most_mb, codes, words, stdin=None):
        begin = time.monotonic()
        with open(stdin or os.devnull, "rb") as source, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            child = subprocess.Popen([str(word) for word in words], stdin=source, stdout=out, stderr=err, cwd=self.work)
            _, status, usage = os.wait4(child.pid, 0)
            err.seek(0), out.seek(0)
            said, printed = err.read().decode(errors="replace"), out.read(400).decode(errors="replace")
        code, mb = os.waitstatus_to_exitcode(status), usage.ru_maxrss // 1024
        fine = code in codes and mb <= most_mb and (code == 0 or said.count("\n") == 1)
        self.failed |= not fine
        line = (said or printed.splitlines()[0] if printed else said).strip().replace(str(self.work) + "/", "")
        print(f"{name:<34} {time.monotonic() - begin:7.2f} s {mb:6d} MB  exit {code}  {line[:110]}{'' if fine else '   NOT AS PROMISED'}", flush=True)


def recording(folder, files):
    folder.mkdir()
    base = {"recording.yaml": "format: rangecal/1\n", "stops.csv": "stop,x_m,y_m,heading_rad\n0,0,0,0\n1,1,0,0\n2,2,0,0\n",
            "observations.csv": "stop,landmark,range_m,bearing_rad\n0,A,1,0.1\n1,A,1,0.2\n2,A,1,0.3\n"}
    for name, text in (base | files).items():
        if text is not None:
            (folder / name).write_text(text)
    return folder


def long_lines(bench):
    size = 2 * GIB
    for name in ("recording.yaml", "stops.csv", "observations.csv"):
        if bench.wants(f"a line of 2 GB, {name}"):
            folder = recording(bench.work / "line", {name: None})
            write_repeated(folder / name, b"a", size)
            bench.run(f"a line of 2 GB, {name}", 256, {2}, [bench.program, "calibrate", folder])
            shutil.rmtree(folder)
    if not bench.wants("a line of 2 GB, text"):
        return
    path = bench.work / "long"
    write_repeated(path, b"1", size)
    for name, words in {"calibration": ["correct", path], "scene": ["simulate", path, "-o", "out"], "study": ["study", path, "-o", "out"],
                        "diagnosis": ["simulate", "--from", path, "-o", "out"], "scans": ["extract", path, "-o", "out"],
                        "stream": ["track", path], "state": ["track", path, "--state", path]}.items():
        bench.run(f"a line of 2 GB, {name}", 256, {1, 2}, [bench.program, *words])
    bench.run("a line of 2 GB, stream on stdin", 256, {2}, [bench.program, "track"], stdin=path)
    path.unlink()


def nested(bench):
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
    texts = {"a million brackets": "x: " + "[" * 1_000_000, "a million maps": "x: " + "{a: " * 1_000_000, "a million dashes": "- " * 1_000_000,
             "10^12 by aliases": bomb, "10^12 by aliases in a text field": "format: rangecal/1\nextraction:\n" + "".join("  " + line + "\n" for line in bomb.splitlines()),
             "an alias of itself": "format: rangecal/1\nextraction: &a {b: [*a, *a]}\n",
             "4 million list items": "format: rangecal/1\nknown_distances: [" + "," * 4_000_000 + "]\n",
             "a million keys": "".join(f"k{i}: 1\n" for i in range(1_000_000))}
    for name, text in texts.items():
        if bench.wants(f"YAML, {name}"):
            folder = recording(bench.work / "yaml", {"recording.yaml": text})
            bench.run(f"YAML, {name}", 4096, {0, 1, 2}, [bench.program, "calibrate", folder])
            shutil.rmtree(folder)
    path = bench.work / "deep.json"
    for name, text in {"a million brackets": "[" * 1_000_000, "closed ones": "[" * 1_000_000 + "]" * 1_000_000,
                       "as a calibrator": '{"format":"rangecal-track/1","calibrator":' + "[" * 1_000_000 + "]" * 1_000_000 + "}"}.items():
        if bench.wants(f"JSON, {name}"):
            path.write_text(text)
            bench.run(f"JSON, {name}: calibration", 512, {2}, [bench.program, "correct", path])
            bench.run(f"JSON, {name}: diagnosis", 512, {2}, [bench.program, "simulate", "--from", path, "-o", "out"])
            bench.run(f"JSON, {name}: state", 512, {2}, [bench.program, "track", "--state", path])


def sizes(bench):
    for rows, most_mb in ((10_000_000, 2000), (100_000_000, 16000)):
        name = f"{rows:.0e} readings".replace("e+0", "e")
        if bench.wants(f"{name}, landmarks"):
            folder = recording(bench.work / "rows", {"observations.csv": None})
            stops = 1000
            (folder / "stops.csv").write_text("stop,x_m,y_m,heading_rad\n" + "".join(f"{k},{0.01 * k:.2f},0,0\n" for k in range(stops)))
            each = rows // (stops * 10)
            write_rows(folder / "observations.csv", "stop,landmark,repeat,time_s,range_m,bearing_rad\n", rows,
                       lambda i: f"{i // (10 * each)},L{i // each % 10},{i % each},{i}e-3,1.{i * 7919 % 1000:03d},0.{i * 31 % 1000:03d}\n")
            print(f"    observations.csv: {(folder / 'observations.csv').stat().st_size / 1e6:.0f} MB", flush=True)
            bench.run(f"{name}, landmarks", most_mb, {0}, [bench.loader, folder])
            shutil.rmtree(folder)
        if bench.wants(f"{name}, pairs"):
            folder = recording(bench.work / "rows", {"observations.csv": None, "stops.csv": None, "recording.yaml": "format: rangecal/1\nkind: pairs\n"})
            write_rows(folder / "pairs.csv", "true_m,reading_m\n", rows, lambda i: f"{1 + i % 4},1.{i * 7919 % 1000:03d}\n")
            bench.run(f"{name}, pairs", most_mb, {0}, [bench.loader, folder])
            shutil.rmtree(folder)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path, nargs="?")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    given = parser.parse_args()
    own = given.work is None
    work = pathlib.Path(tempfile.mkdtemp(prefix="rangecal-hostile-")) if own else given.work
    work.mkdir(exist_ok=True)
    bench = Bench(given.build.resolve(), work.resolve(), given.only)
    try:
        nested(bench)
        long_lines(bench)
        sizes(bench)
    finally:
        if own:
            shutil.rmtree(work)
    sys.exit(1 if bench.failed else 0)


main()
