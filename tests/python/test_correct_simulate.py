# SPDX-License-Identifier: BSD-3-Clause
import io

import numpy as np
import pandas
import pytest

import rangecal


@pytest.mark.parametrize("roots", ["ls", "ml"])
def test_correct_is_that_of_the_program(roots, calibration, command, tmp_path):
    calibration.save(str(tmp_path / "cal.json"))
    readings = [0.3, 1.234, 2.5, 0.0, -1.0, 100.0]
    printed = command("correct", tmp_path / "cal.json", "--roots", roots, input="\n".join(map(str, readings)))
    theirs = pandas.read_csv(io.StringIO(printed))
    ours = rangecal.correct(calibration, readings, roots=roots).to_frame()
    assert list(ours["flag"]) == list(theirs["flag"])
    for column in ("reading_m", "distance_m", "std_m"):   # printed with six decimals
        np.testing.assert_allclose(ours[column], theirs[column], atol=5.1e-7)


def test_correct_inverts_the_curve(calibration):
    d = np.linspace(0.6, 4.5, 9)
    corrected = rangecal.correct(calibration, calibration.f(d))
    np.testing.assert_allclose(corrected.distance_m, d, rtol=1e-9)
    assert set(corrected.flag) == {"ok"} and np.all(corrected.std_m > 0)


def test_one_number_a_table_and_a_recording(calibration, field):
    one = rangecal.correct(calibration, 1.234)
    assert one.distance_m.shape == (1,)
    table = rangecal.correct(calibration, field.to_frame())
    np.testing.assert_array_equal(table.distance_m, rangecal.correct(calibration, field).distance_m)
    missing = rangecal.correct(calibration, [np.nan, np.inf])
    assert list(missing.flag) == ["missing", "not_finite"] and np.all(np.isnan(missing.distance_m))
    with pytest.raises(rangecal.InputError, match="no column reading_m or range_m"):
        rangecal.correct(calibration, pandas.DataFrame({"x": [1.0]}))


def test_effects_are_undone_and_their_columns_asked_for(diagnosis, eccentric):
    completed = diagnosis.corrected
    assert "range_eccentricity" in completed.effects
    with pytest.raises(rangecal.InputError, match="bearing_rad.*range_eccentricity"):
        rangecal.correct(completed, eccentric.range_m)
    undone = rangecal.correct(completed, eccentric)
    by_hand = rangecal.correct(completed, eccentric.range_m, bearing_rad=eccentric.bearing_rad)
    np.testing.assert_array_equal(undone.distance_m, by_hand.distance_m)
    d = np.hypot(*(eccentric.true_landmarks[eccentric.landmark] - eccentric.true_stops[eccentric.stop, :2]).T) \
        - np.asarray(eccentric.landmark_radius_m)[eccentric.landmark]
    plain = rangecal.correct(diagnosis.baseline, eccentric.range_m)
    near = d < 2.0   # where noise of 10 mm at 1 m does not hide 28 mm of eccentricity
    assert np.std((undone.distance_m - d)[near]) < 0.8 * np.std((plain.distance_m - d)[near])


def test_simulate_is_that_of_the_program(source, command, tmp_path):
    scene = source / "notebooks_data/scenes/field-layout.yaml"
    command("simulate", scene, "-o", tmp_path / "sim", "--seed", 7)
    theirs, ours = rangecal.load(tmp_path / "sim"), rangecal.simulate(scene, 7)
    np.testing.assert_array_equal(ours.range_m, theirs.range_m)
    np.testing.assert_array_equal(ours.true_stops, theirs.true_stops)


def test_a_scene_as_a_dictionary():
    scene = {"sensor": {"alpha": np.array([0.0, 1.0]), "noise": {"law": "constant", "sigma": 1e-9},
                        "sigma_theta_rad": 1e-9},
             "stops": {"line": {"count": 3, "step_m": 1.0}, "sigma_xy_m": 0.0},
             "landmarks": {"list": [{"landmark": "A", "x_m": 3.0, "y_m": 4.0}]}}
    recording = rangecal.simulate(scene)
    # Stops at x = 0, 1, 2; the landmark at (3, 4): distances 5, sqrt(4 + 16), sqrt(1 + 16).
    np.testing.assert_allclose(recording.range_m, [5.0, np.sqrt(20.0), np.sqrt(17.0)], atol=1e-7)
    with pytest.raises(rangecal.InputError, match="the scene, row 1: field 'colour'"):
        rangecal.simulate({**scene, "colour": 1})
    with pytest.raises(rangecal.InputError, match="no effect is called 'ghost'"):
        rangecal.simulate(scene, effects={"ghost": {}})


def test_a_layout_with_a_calibration(field, calibration):
    again = rangecal.simulate(field, 3, calibration=calibration)
    np.testing.assert_array_equal(again.stop, field.stop)
    assert not np.array_equal(again.range_m, field.range_m)
    np.testing.assert_array_equal(again.true_landmarks, calibration.landmarks)
    with pytest.raises(rangecal.InputError, match="takes a calibration"):
        rangecal.simulate(field)
