# SPDX-License-Identifier: BSD-3-Clause
"""Where the tests find the sources and the program; run by ctest, which says where these are."""
import math
import os
import pathlib
import subprocess

import matplotlib
import numpy as np
import pytest

import rangecal

matplotlib.use("Agg")


@pytest.fixture(scope="session")
def source():
    return pathlib.Path(os.environ.get("RANGECAL_SOURCE_DIR", pathlib.Path(__file__).parents[2]))


@pytest.fixture(scope="session")
def command():
    """Runs the program and returns what it printed."""
    program = os.environ.get("RANGECAL_BINARY")
    if not program:
        pytest.skip("RANGECAL_BINARY does not name the program")

    def run(*arguments, **options):
        return subprocess.run([program, *map(str, arguments)], check=True, capture_output=True, text=True,
                              **options).stdout

    return run


@pytest.fixture(scope="session")
def field(source):
    return rangecal.load(source / "notebooks_data/field-layout")


@pytest.fixture(scope="session")
def pairs(source):
    return rangecal.load(source / "notebooks_data/pairs-2016")


@pytest.fixture(scope="session")
def calibration(field):
    return rangecal.calibrate(field)


@pytest.fixture(scope="session")
def eccentric(source):
    """A recording whose range errs by 20 mm (cosine) and 20 mm (sine) once per turn of the sensor."""
    return rangecal.simulate(source / "notebooks_data/scenes/field-layout.yaml", 2,
                             effects={"range_eccentricity": {"cosine_m": 0.02, "sine_m": 0.02}})


@pytest.fixture(scope="session")
def diagnosis(eccentric):
    return rangecal.diagnose(eccentric)


def assert_same(ours, theirs, where=""):
    """Both JSON documents agree to 1e-12, relative or absolute; wall times aside."""
    assert type(ours) is type(theirs) or {type(ours), type(theirs)} <= {int, float}, where
    if isinstance(theirs, dict):
        assert list(ours) == list(theirs), where
        for key in theirs:
            if key != "seconds":
                assert_same(ours[key], theirs[key], f"{where}.{key}")
    elif isinstance(theirs, list):
        assert len(ours) == len(theirs), where
        for i, (a, b) in enumerate(zip(ours, theirs)):
            assert_same(a, b, f"{where}[{i}]")
    elif isinstance(theirs, float):
        assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-12), where
    else:
        assert ours == theirs, where


def scans_of(cylinders, stops, radius=0.1, half_room=4.0, beams=720):
    """A row per beam in a square room with cylinders: exact ranges with a millimetre of noise from a fixed seed."""
    random = np.random.default_rng(5)
    table = {"stop": [], "stamp": [], "angle_rad": [], "range_m": []}
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    for k, (x, y) in enumerate(stops):
        c, s = np.cos(angles), np.sin(angles)
        with np.errstate(divide="ignore"):
            ranges = np.minimum(np.where(c > 0, half_room - x, -half_room - x) / c,
                                np.where(s > 0, half_room - y, -half_room - y) / s)
        for cx, cy in cylinders:
            along, across = (cx - x) * c + (cy - y) * s, (cy - y) * c - (cx - x) * s
            hit = (np.abs(across) < radius) & (along > 0)
            near = along - np.sqrt(np.where(hit, radius**2 - across**2, 0.0))
            ranges = np.where(hit & (near < ranges), near, ranges)
        table["stop"] += [str(k)] * beams
        table["stamp"] += [float(k)] * beams
        table["angle_rad"] += list(angles)
        table["range_m"] += list(ranges + random.normal(0.0, 0.001, beams))
    return table
