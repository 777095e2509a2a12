# SPDX-License-Identifier: BSD-3-Clause
import json
import pickle

import numpy as np
import pytest

import rangecal
from conftest import assert_same


def test_diagnosis_is_that_of_the_program(eccentric, diagnosis, command, tmp_path):
    eccentric.save(str(tmp_path / "rec"))
    command("diagnose", tmp_path / "rec", "--json", tmp_path / "d.json", "--calibration", tmp_path / "cal.json")
    theirs = json.loads((tmp_path / "d.json").read_text())
    ours = diagnosis.to_dict()
    del ours["simulation"], theirs["simulation"]   # holds the recording's path
    assert_same(ours, theirs)
    assert_same(diagnosis.corrected.to_dict(), json.loads((tmp_path / "cal.json").read_text()))


def test_the_effect_is_named_and_measured(diagnosis):
    assert diagnosis.verdict == "explained" and diagnosis.final_effects == ["range_eccentricity"]
    best = diagnosis.explanations[0]
    amplitude = {p.name: p for p in best.parameters}["range_eccentricity.amplitude_m"]
    assert amplitude.ci95[0] < np.hypot(0.02, 0.02) < amplitude.ci95[1]
    assert diagnosis.after.nll < diagnosis.before.nll and diagnosis.after.heldout_nll < diagnosis.before.heldout_nll
    found = diagnosis.location[0]
    assert (found.channel, found.covariate) == ("range", "sensor_bearing")
    assert found.at.shape == found.before.shape == found.after.shape and np.sum(found.readings) == 500
    assert np.mean(np.abs(found.after)) < np.mean(np.abs(found.before))


def test_what_is_known_of_effects_and_curve_together(diagnosis, calibration):
    corrected = diagnosis.corrected
    names, covariance = corrected.effects_covariance_parameters, corrected.effects_covariance
    assert names == corrected.to_dict()["effects_covariance"]["parameters"]
    assert {name.partition(".")[0] for name in names} == {"range_eccentricity"}
    n = corrected.order + 1
    assert covariance.shape == (n + len(names), n + len(names)) and not covariance.flags.writeable
    np.testing.assert_array_equal(covariance, corrected.to_dict()["effects_covariance"]["matrix"])
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
    # cov(alpha) = C + B P B^T, C given the effect: no variance is smaller than where the effect is known.
    assert np.all(np.diag(covariance)[:n] > (1 - 1e-9) * np.diag(corrected.covariance))
    assert calibration.effects_covariance is None and calibration.effects_covariance_parameters == []


def test_frames(diagnosis):
    for table, columns in (("explanations", "effects"), ("location", "covariate"), ("fit", "before"),
                           ("unseen", "harm_m"), ("next_experiments", "power")):
        assert columns in diagnosis.to_frame(table).columns
    assert len(diagnosis.to_frame("explanations")) == sum(len(e.parameters) for e in diagnosis.explanations)
    with pytest.raises(ValueError, match="table is 'x'"):
        diagnosis.to_frame("x")


def test_a_frame_of_every_reading(diagnosis, eccentric, pairs):
    frame = diagnosis.to_frame("readings")
    assert len(frame) == len(eccentric)
    for name, column in eccentric.to_frame().items():
        assert (frame[name] == column).all(), name
    before = rangecal.residuals(eccentric, diagnosis.baseline)
    assert set(before.row) == set(frame.row)
    by_row = before.to_frame().set_index("row").range_residual_m
    assert np.array_equal(frame.range_residual_before_m, by_row[frame.row])
    assert (frame.range_residual_after_m ** 2).sum() < (frame.range_residual_before_m ** 2).sum()
    clean = rangecal.diagnose([pairs, pairs], held_out=False, unseen=False, next_experiments=False).to_frame("readings")
    assert len(clean) == 2 * len(pairs) and "bearing_residual_after_rad" not in clean
    assert np.array_equal(clean.true_m[:len(pairs)], pairs.true_m)
    again = pickle.loads(pickle.dumps(diagnosis)).to_frame("readings")
    assert again.equals(frame)


def test_a_clean_recording_has_no_mismatch(field):
    diagnosis = rangecal.diagnose(field, held_out=False, unseen=False, next_experiments=False)
    assert diagnosis.verdict == "no_mismatch" and diagnosis.final_effects == []
    assert len(diagnosis.to_frame()) == 0 and diagnosis.unseen == []


def test_held_against_a_calibration_and_a_recording(field, eccentric, calibration, tmp_path):
    quick = {"held_out": False, "unseen": False, "next_experiments": False}
    assert rangecal.diagnose(eccentric, calibration, **quick).verdict != "no_mismatch"
    assert rangecal.diagnose(eccentric, field, **quick).verdict != "no_mismatch"
    path = tmp_path / "cal.json"
    calibration.save(str(path))
    assert rangecal.diagnose(field, str(path), **quick).verdict == "no_mismatch"


def test_its_model_simulates_the_recording_again(diagnosis, eccentric):
    again = rangecal.simulate(diagnosis, 1)
    np.testing.assert_array_equal(again.landmark, eccentric.landmark)
    assert "range_eccentricity" in rangecal.diagnose(again, unseen=False, next_experiments=False).final_effects


def test_residuals(diagnosis, eccentric):
    before = rangecal.residuals(eccentric, diagnosis.baseline, along=["sensor_bearing"])
    after = rangecal.residuals(eccentric, diagnosis.corrected, along=["sensor_bearing"])
    assert len(before) == 500 and before.range_residual_m.base is before
    white = [np.mean((r.range_residual_m / r.range_std_m) ** 2) for r in (before, after)]
    assert abs(white[1] - 1.0) < 0.25   # four standard deviations of the mean of 500 squares
    frame = after.to_frame()
    np.testing.assert_array_equal(frame["sensor_bearing"], after.along["sensor_bearing"])
    # The reading is the distance through the curve plus what is left, effects aside.
    f = diagnosis.baseline.f(before.distance_m)
    np.testing.assert_allclose(before.reading_m - f, before.range_residual_m, atol=1e-12)


def test_residuals_along_what_is_known(field, pairs, calibration):
    one, several = rangecal.residuals(field, calibration, "range"), rangecal.residuals(field, calibration, ["range"])
    assert list(one.along) == ["range"] and one.to_frame().equals(several.to_frame())
    np.testing.assert_array_equal(one.along["range"], one.distance_m)
    for wrong, message in ((["range", "foo"], "covariate 'foo' is not known; known here: range, disparity"),
                           ("sensor_baring", "did you mean 'sensor_bearing'"), (None, "'None'"), (5, "'5'")):
        with pytest.raises(rangecal.InputError, match=message):
            rangecal.residuals(field, calibration, wrong)
    every = ("range", "disparity", "sensor_bearing", "heading", "time", "stop", "repeat", "landmark", "radius")
    assert set(rangecal.residuals(field, calibration, every).along) == set(every)   # as the message has them
    warm = rangecal.Recording(pairs={"true_m": [1.0, 2.0], "reading_m": [1.0, 2.0], "temperature_c": [20.0, 21.0]})
    found = rangecal.residuals(warm, rangecal.calibrate(pairs, order=1, noise="constant"), "temperature_c")
    np.testing.assert_array_equal(found.along["temperature_c"], [20.0, 21.0])


def test_catalogue():
    effects = rangecal.effects()
    assert [e.id for e in effects] == sorted(e.id for e in effects)
    one = {e.id: e for e in effects}["range_eccentricity"]
    assert one.physics and one.formula and [p.name for p in one.parameters] == ["cosine_m", "sine_m"]


def test_wrong_options(field):
    with pytest.raises(rangecal.InputError, match="alarm_rate is 2, not between 0 and 1"):
        rangecal.diagnose(field, alarm_rate=2.0)
    with pytest.raises(rangecal.InputError, match="ghost"):
        rangecal.diagnose(field, force=["ghost"])
    with pytest.raises(rangecal.InputError, match="without: no effect is called 'ghost'"):
        rangecal.diagnose(field, without="ghost")
