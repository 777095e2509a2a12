# SPDX-License-Identifier: BSD-3-Clause
"""What does not fit is named in one line of the caller's words; nothing of the C++ side shows, and None ends no program."""
import pathlib

import numpy as np
import pytest

import rangecal
from rangecal import _native

SCENE = {"sensor": {"alpha": [0.0, 1.0], "noise": {"law": "constant", "sigma": 0.01}, "sigma_theta_rad": 0.01},
         "stops": {"line": {"count": 3, "step_m": 1.0}}, "landmarks": {"list": [{"landmark": "A", "x_m": 3.0, "y_m": 4.0}]}}

# Calls of a recording r and a calibration c, and how the message begins.
OTHER_CLASS = [
    (lambda r, c: rangecal.load(None), "path is None, not a path"),
    (lambda r, c: rangecal.calibrate(None), "recordings: None is not a Recording"),
    (lambda r, c: rangecal.calibrate([r, None]), "recordings: None is not a Recording"),
    (lambda r, c: rangecal.calibrate(c), "recordings: <rangecal.Calibration"),
    (lambda r, c: rangecal.calibrate(r, start=r), "start is <rangecal.Recording"),
    (lambda r, c: rangecal.calibrate(r, progress=3), "progress is 3, not a function"),
    (lambda r, c: rangecal.compare(3), "recordings: 3 is not"),
    (lambda r, c: rangecal.correct(None, [1.0]), "calibration is None, not a Calibration"),
    (lambda r, c: rangecal.correct(r, [1.0]), "calibration is <rangecal.Recording"),
    (lambda r, c: rangecal.residuals(r, None), "calibration is None, not a Calibration"),
    (lambda r, c: rangecal.residuals(None, c), "recordings: None is not a Recording"),
    (lambda r, c: rangecal.compare_curves(None, c), "before is None, not a Calibration"),
    (lambda r, c: rangecal.compare_curves(c, None), "after is None, not a Calibration"),
    (lambda r, c: rangecal.diagnose(None), "recordings: None is not a Recording"),
    (lambda r, c: rangecal.diagnose(r, 5), "simulation: 5 is not a Recording"),
    (lambda r, c: rangecal.simulate(None), "scene is None, not a path, a dictionary, a Diagnosis or recordings"),
    (lambda r, c: rangecal.simulate([None], calibration=c), "scene: None is not a Recording"),
    (lambda r, c: rangecal.simulate(r, calibration=r), "calibration is <rangecal.Recording"),
    (lambda r, c: rangecal.study(None), "path is None, not a path"),
    (lambda r, c: rangecal.extract(None), "scans: None is no table"),
    (lambda r, c: rangecal.extract("x.csv", 5), "stops: 5 is no table"),
    (lambda r, c: rangecal.import_dataset("lego", None), "path is None, not a path"),
    (lambda r, c: rangecal.Recording(5, {}), "observations.csv: 5 is no table"),
    (lambda r, c: rangecal.Recording(pairs={}, sensor={"name": object}), "<class 'object'> is no text"),
    (lambda r, c: r.save(None), "folder is None, not a path"),
    (lambda r, c: c.save(None), "path is None, not a path"),
    (lambda r, c: c.report(None), "path is None, not a path"),
]
WRONG_VALUE = [
    (lambda r, c: rangecal.load("\udcff"), r"path is '\\udcff', which is not UTF-8"),
    (lambda r, c: rangecal.calibrate([]), "recordings: no recording is given"),
    (lambda r, c: rangecal.calibrate(r, None), "method is 'None', not one of"),
    (lambda r, c: rangecal.calibrate(r, order=2.5), "order is 2.5, not a whole number"),
    (lambda r, c: rangecal.calibrate(r, order=2**40), "order is 1099511627776, beyond"),
    (lambda r, c: rangecal.calibrate(r, noise=3), "noise law is '3'"),
    (lambda r, c: rangecal.calibrate(r, check="no"), "check is 'no', not True or False"),
    (lambda r, c: rangecal.compare(r, methods=None), "method is 'None', not one of"),
    (lambda r, c: rangecal.correct("none.json", [1.0]), "none.json: no such file"),
    (lambda r, c: rangecal.correct(c, None), "readings: None is no array of numbers"),
    (lambda r, c: rangecal.correct(c, ["far"]), r"readings: \['far'\] is no array of numbers"),
    (lambda r, c: rangecal.correct(c, np.array([1j])), "readings: .* is no array of numbers"),
    (lambda r, c: rangecal.correct(c, [1.0], roots=None), "roots is 'None', not ls or ml"),
    (lambda r, c: rangecal.diagnose(r, []), "simulation: no recording is given"),
    (lambda r, c: rangecal.diagnose(r, alarm_rate="low"), "alarm_rate is 'low', not a finite number"),
    (lambda r, c: rangecal.diagnose(r, force="ghost"), "no effect is called 'ghost'|.*ghost"),
    (lambda r, c: rangecal.diagnose(r, unseen=0), "unseen is 0, not True or False"),
    (lambda r, c: rangecal.simulate(SCENE, -1), "seed is -1, not at least 0"),
    (lambda r, c: rangecal.simulate(SCENE, 1.5), "seed is 1.5, not a whole number"),
    (lambda r, c: rangecal.simulate(SCENE, 2**64), "seed is 18446744073709551616, beyond 18446744073709551615"),
    (lambda r, c: rangecal.simulate(SCENE, effects=["tilt"]), r"effects is \['tilt'\], not a dictionary"),
    (lambda r, c: rangecal.simulate(SCENE, effects={"tilt": 0.1}), "effects is {'tilt': 0.1}, not a dictionary"),
    (lambda r, c: rangecal.simulate(SCENE, effects={"range_offset": {"offset_m": np.nan}}),
     "effects: range_offset.offset_m is nan, not a finite number"),
    (lambda r, c: rangecal.study("x.yaml", repeats=1.5), "repeats is 1.5, not a whole number"),
    (lambda r, c: rangecal.study("x.yaml", threads=-1), "threads is -1, not at least 0"),
    (lambda r, c: rangecal.extract("x.csv", radius_m="wide"), "radius_m: 'wide' is no array of numbers"),
    (lambda r, c: rangecal.extract("x.csv", clockwise="no"), "clockwise is 'no', not True or False"),
    (lambda r, c: rangecal.import_dataset(5, "x"), "no importer is called '5'"),
    (lambda r, c: rangecal.Recording(pairs={}, known_distances=5), ".*'known_distances': is not a list"),
    (lambda r, c: rangecal.Recording(pairs={}, extraction="x"), ".*'extraction': is not a map"),
    (lambda r, c: c.f(None), "distance_m: None is no array of numbers"),
    (lambda r, c: c.noise("far"), "distance_m: 'far' is no array of numbers"),
]


@pytest.mark.parametrize("call, message", OTHER_CLASS, ids=[m for _, m in OTHER_CLASS])
def test_another_class_of_object_is_a_type_error(call, message, field, calibration):
    with pytest.raises(TypeError, match=f"^{message}") as error:
        call(field, calibration)
    assert "\n" not in str(error.value) and "_native" not in str(error.value)


@pytest.mark.parametrize("call, message", WRONG_VALUE, ids=[m for _, m in WRONG_VALUE])
def test_a_wrong_value_is_an_input_error(call, message, field, calibration):
    with pytest.raises(rangecal.InputError, match=f"^{message}") as error:
        call(field, calibration)
    assert "\n" not in str(error.value) and "_native" not in str(error.value)


@pytest.mark.parametrize("call", [
    lambda r, c: _native.correct_readings(None, np.ones(1), {}, "ls"),
    lambda r, c: _native.columns_needed(None),
    lambda r, c: _native.residuals_job([r], None, []),
    lambda r, c: _native.residuals_job([None], c, []),
    lambda r, c: _native.calibrate_job([None], [], None, None, "gaussian", "ceres", "consistent", False, None, None),
    lambda r, c: _native.diagnose_job([None], None, [], 0.02, None, False, False, False, None),
    lambda r, c: _native.diagnose_job([r, None], None, [], 0.02, None, False, False, False, None),
    lambda r, c: _native.diagnose_job([r], None, [None], 0.02, None, False, False, False, None),
    lambda r, c: _native.simulate_layout([None], c, {}, 1),
    lambda r, c: _native.simulate_layout([r], None, {}, 1),
    lambda r, c: _native.compare_curves(c, None),
    lambda r, c: _native.report_calibration(None, 0, [r], "x.html"),
    lambda r, c: _native.report_comparison(None, [r], "x.html"),
    lambda r, c: _native.report_diagnosis(None, [r], "x.html"),
    lambda r, c: _native.calibration_summary(None, 0, [r]),
    lambda r, c: _native.comparison_summary(None, [r]),
    lambda r, c: _native.calibration_summary(*c._origin[:2], [None]),
    lambda r, c: _native.diagnosis_summary(None),
    lambda r, c: rangecal.Diagnosis.simulate_all(None, 1),
    lambda r, c: rangecal.Calibration.f(None, 1.0),
    lambda r, c: rangecal.Calibration.save(None, "x.json"),
    lambda r, c: rangecal.Calibration.to_json(None),
    lambda r, c: rangecal.Recording.__len__(None),
])
def test_none_in_place_of_any_object_of_the_other_side_is_a_type_error(call, field, calibration):
    with pytest.raises(TypeError):
        call(field, calibration)
    assert not pathlib.Path("x.html").exists()


def test_columns_of_another_length_reach_no_reading(diagnosis):
    with pytest.raises(rangecal.InputError, match="2 of them, where their columns have 1"):
        _native.correct_readings(diagnosis.corrected, np.ones(2), {"bearing_rad": [0.1]}, "ls")


def test_one_name_is_a_list_of_one(field):
    assert [c.method for c in rangecal.compare(field, methods="closed-form")] == ["closed-form"]
    quick = {"held_out": False, "unseen": False, "next_experiments": False}
    assert rangecal.diagnose(field, force="tilt", **quick).final_effects == ["tilt"]
