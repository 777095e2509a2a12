#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""make_seeds.py BUILD OUT: inputs for the fuzzers in OUT/READER, cut out of the shipped files or written by the programs of
the build."""
import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
DATA = ROOT / "notebooks_data"


def head(path, lines):
    return "\n".join(path.read_text().splitlines()[:lines]) + "\n"


def together(files):
    return "".join(f"=== {name}\n{text}" for name, text in files.items())


def recording(folder, lines):
    files = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".yaml":
            files[path.name] = path.read_text()
        elif path.suffix == ".csv":
            files[path.name] = head(path, lines if path.name in ("observations.csv", "pairs.csv") else 400)
    return together(files)


def small(value):
    """The same JSON with lists cut short, so that a fuzzer has less to copy."""
    if isinstance(value, dict):
        return {key: small(item) for key, item in value.items()}
    return [small(item) for item in value[:12]] if isinstance(value, list) and len(value) > 24 else value


def made_by_the_programs(build, put):
    program = build / "apps" / "rangecal"
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)

        def run(*words):   # exit code 1: too few readings for an answer, which is as good a file
            code = subprocess.run([program, *words], cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
            assert code in (0, 1), words

        run("simulate", DATA / "scenes" / "pairs-2016.yaml", "-o", "pairs")
        (work / "stream.csv").write_text(head(work / "pairs" / "pairs.csv", 60))
        run("calibrate", "pairs", "--method", "all", "--json", "pairs.json")
        run("calibrate", DATA / "field-layout", "--json", "field.json")
        for part in ("pairs", "field"):
            put("calibration", part, (work / f"{part}.json").read_text())
        run("diagnose", "pairs", "--json", "diagnosis.json")
        found = json.loads((work / "diagnosis.json").read_text())
        put("diagnosis", "pairs", json.dumps(small({"simulation": found["simulation"]})))
        put("diagnosis", "whole", json.dumps(found)[:60000])
        run("track", "stream.csv", "-o", "out.csv", "--state", "state.json")
        state = json.loads((work / "state.json").read_text())
        put("calibrator", "pairs", json.dumps(state["calibrator"]))
        state["fingerprint"] = ""  # of another stream: a mutant would be refused before it is read
        put("track", "resumed", together({"state.json": json.dumps(state) + "\n", "stream.csv": (work / "stream.csv").read_text()}))
        put("track", "new", together({"stream.csv": (work / "stream.csv").read_text()}))
        scans = scan_csv(8, 4)
        (work / "scans.csv").write_text(scans)
        if (build / "tests" / "write_bag").exists():
            subprocess.run([build / "tests" / "write_bag", "scans.csv", "scans.bag"], cwd=work, check=True)
            put("bag", "scans", (work / "scans.bag").read_bytes())
        if (build / "tests" / "write_bags").exists():
            subprocess.run([build / "tests" / "write_bags", work / "bags"], check=True)
            for path in sorted((work / "bags").glob("*/*")):
                put(path.parent.name, path.name, path.read_bytes())


def scan_csv(beams, scans):
    rows = ["stamp,angle_min,angle_increment," + ",".join(f"r{i}" for i in range(beams))]
    for k in range(scans):
        rows.append(f"{0.1 * k:.1f},-0.4,0.1," + ",".join(f"{1 + 0.01 * i:.2f}" for i in range(beams)))
    return "\n".join(rows) + "\n"


def data_sets(put):
    motion = "".join(f"{0.1 * i:.1f} {0.01 * i:.2f} 0.5 0.1\n" for i in range(40))
    put("mrclam", "small", together({
        "Barcodes.dat": "# subject barcode\n1 5\n6 63\n7 25\n", "Landmark_Groundtruth.dat": "6 1.9 -0.2 0.001 0.001\n7 0.1 1.5 0.001 0.001\n",
        "Robot1_Groundtruth.dat": motion, "Robot1_Odometry.dat": "0.0 0.1 0.0\n1.0 0.1 0.2\n",
        "Robot1_Measurement.dat": "".join(f"{0.5 + 0.1 * i:.1f} {63 if i % 2 else 25} 1.5 0.{i}\n" for i in range(9))}))
    scan = "S 100 660 " + " ".join("2200" if abs(i - 330) > 20 else f"{int(1000 - 40 * math.sqrt(1 - (i - 330) ** 2 / 441))}" for i in range(660))
    put("lego", "small", together({
        "robot4_scan.txt": scan + "\n" + scan + "\n", "robot4_motors.txt": "M 100 0 0 0 0 0\nM 200 10 0 0 0 12\n",
        "robot4_reference.txt": "P 100 1850 1897\n", "robot_arena_landmarks.txt": "L C 900 1300 90\nL C 500 250 90\n"}))


def main():
    build, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    shutil.rmtree(out, ignore_errors=True)

    def put(reader, name, text):
        (out / reader).mkdir(parents=True, exist_ok=True)
        path = out / reader / name
        path.write_bytes(text) if isinstance(text, bytes) else path.write_text(text)

    for folder in (DATA / "field-layout", DATA / "pairs-2016", DATA / "concealed" / "world-01", DATA / "2021-setting"):
        put("recording", folder.name, recording(folder, 30))
        for path in sorted(folder.glob("*.csv")):
            put("csv", f"{folder.name}-{path.name}", head(path, 12))
    put("csv", "quotes", '\ufeffa,"b ""q"""\r\n 1 ,"x,y"\r\n\r\n2,"two\nlines"\r\n')
    put("table", "spreadsheet", '\ufefftruth [cm];"sonar\n[mm]";time;which\r\n57,0;571,5;2024-05-01T12:00:00,5;"a;b"\r\n;;;\r\n')
    put("table", "plain", "n,truth,sonar,time,which,c\n1,1.5,1.6,1714550400500,a,20\n2,NA,1.6,1714550401000,b,-\n3,2.5,2.6,,b,1e3\n")
    for path in sorted((DATA / "scenes").glob("*.yaml")):
        put("scene", path.name, path.read_text())
    for path in sorted((DATA / "studies").glob("*.yaml")):
        text = path.read_text()
        put("study", path.name, "\n".join("scene: field-layout.yaml" if line.startswith("scene:") else line for line in text.splitlines()) + "\n")
    put("scans", "wide", scan_csv(6, 3))
    put("scans", "long", "stamp,angle_rad,range_m,stop\n0,0.1,1,a\n0,0.2,1.1,a\n1,0.1,nan,b\n")
    put("scans", "carmen", "# log\nPARAM laser 1\nFLASER 3 1.0 1.1 1.2 0 0 0 0 0 0 12.5 host 0.1\n"
        "ROBOTLASER1 0 -1.57 3.14 0.5 80 0.01 0 3 1 2 3 0 0 0 0 0 0 0 1 2 3 4 5 12.5 host 0.1\nODOM 0 0 0 0 0 0 1 host 1\n")
    put("population", "small", json.dumps({"format": "rangecal-population/1", "outcome": "converged", "reason": "", "order": 0, "law": "f2",
        "range_m": [0.1, 4], "units": 9, "left_out": 0, "log_likelihood": 1.5, "iterations": 3, "mean": [1.0, 2.0], "covariance": [[1, 0], [0, 1]]}))
    put("journal", "scores", "row,design,index,seed,planted,size,lambda_or_nats,answer,class,set_size,probability,alarm_p,location,located,"
        "gain_ratio,gain_excess_nats,covered,intervals,held_out_improves,listed,experiment,experiment_good,seconds,partly_right,error\n"
        "clean,line,0,7,,0,0,,quiet,0,0.0000,0.5,,0,,,0,0,,,,,0.100,0,\n")
    put("journal", "unit", "u 0 0 2 2 1 1.5 2.5 0.1 0123456789abcdef\n")
    data_sets(put)
    made_by_the_programs(build, put)


main()
