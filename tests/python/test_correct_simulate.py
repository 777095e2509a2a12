# SPDX-License-Identifier: BSD-3-Clause
import io
import json

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
    columns = {"reading_m": np.array([1.234, 2.5]), "x": np.array(["a", "b"])}
    plain = rangecal.correct(calibration, columns["reading_m"]).distance_m
    for same in (columns, pandas.DataFrame(columns), pandas.DataFrame(columns).to_records()):
        np.testing.assert_array_equal(rangecal.correct(calibration, same).distance_m, plain)


def test_a_path_stands_for_what_is_in_it(calibration, field, tmp_path):
    path = tmp_path / "cal.json"
    calibration.save(path)
    np.testing.assert_array_equal(rangecal.correct(path, [1.2]).distance_m,
                                  rangecal.correct(calibration, [1.2]).distance_m)
    np.testing.assert_array_equal(rangecal.residuals(field, str(path)).range_residual_m,
                                  rangecal.residuals(field, calibration).range_residual_m)
    assert rangecal.compare_curves(path, calibration).largest_m == 0.0


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


def test_keywords_of_correct_are_known_and_as_long_as_the_readings(calibration, diagnosis):
    completed = diagnosis.corrected   # by an eccentricity, which needs bearings
    for wrong, message in (({"root": "ml"}, r"'root' is not known \(did you mean 'roots'\?\)"),
                           ({"bearing": [0.1, 0.2]}, "did you mean 'bearing_rad'"),
                           ({"prior": "uniform", "limits": [1.0]}, "'prior' is not known; known here: roots, bearing_rad"),
                           ({"temperature_c": 20.0}, "'temperature_c' is not known"),   # no effect of theirs needs it
                           ({"bearing_rad": [0.1]}, "bearing_rad has 1 entries, where there are 2 readings"),
                           ({"bearing_rad": [0.1, 0.2, 0.3]}, "bearing_rad has 3 entries, where there are 2 readings"),
                           ({"bearing_rad": [[0.1, 0.2]]}, "bearing_rad is not one-dimensional"),
                           ({"time_s": [[0.1], [0.2, 0.3]]}, "time_s is not one-dimensional")):
        for one in (calibration, completed):
            with pytest.raises(rangecal.InputError, match=message):
                rangecal.correct(one, [1.2, 1.3], **wrong)
    one = rangecal.correct(completed, [1.2, 1.3], bearing_rad=0.1, stop=None)   # None: not given
    both = rangecal.correct(completed, [1.2, 1.3], bearing_rad=[0.1, 0.1])
    np.testing.assert_array_equal(one.distance_m, both.distance_m)
    # From a table come the columns that are not given by name.
    table = rangecal.correct(completed, {"reading_m": [1.2, 1.3], "bearing_rad": [2.0, 2.0], "x": [0, 0]}, bearing_rad=0.1)
    np.testing.assert_array_equal(table.distance_m, both.distance_m)


def test_covariates_of_effects_are_known_to_correct(calibration, tmp_path):
    by_temperature = {"range_scale": {"scale": 0.01, "form": 1.0}}
    (tmp_path / "cal.json").write_text(json.dumps({**calibration.to_dict(), "effects": by_temperature}))
    warm = rangecal.load(tmp_path / "cal.json")
    with pytest.raises(rangecal.InputError, match="temperature_c.*range_scale"):
        rangecal.correct(warm, [1.2])
    same = rangecal.correct(warm, [1.2], temperature_c=20.0)   # the temperature at which nothing is scaled
    np.testing.assert_allclose(same.distance_m, rangecal.correct(calibration, [1.2]).distance_m, rtol=1e-9)
    assert rangecal.correct(warm, [1.2], temperature_c=40.0).distance_m < same.distance_m   # reads longer when warm


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


def test_effects_of_a_scene_are_those_of_the_argument(source, command, tmp_path):
    scene = {"sensor": {"alpha": [0.05, 0.9, 0.05], "noise": {"law": "f2", "sigma": 0.01}, "sigma_theta_rad": 0.009},
             "stops": {"line": {"count": 5, "step_m": 0.3}}, "repeats": 4,
             "landmarks": {"radius_m": 0.1, "list": [{"landmark": "A", "x_m": 0.4, "y_m": 0.9},
                                                     {"landmark": "B", "x_m": 1.6, "y_m": -0.7}]}}
    effects = {"range_eccentricity": {"cosine_m": 0.02}, "quantisation": {"output_step_m": 0.002}}
    within, beside = rangecal.simulate({**scene, "effects": effects}, 3), rangecal.simulate(scene, 3, effects=effects)
    np.testing.assert_array_equal(within.range_m, beside.range_m)
    np.testing.assert_allclose(within.range_m / 0.002, np.round(within.range_m / 0.002), atol=1e-9)
    with pytest.raises(rangecal.InputError, match="range_eccentricity.cosine_m: 50 is outside"):
        rangecal.simulate(scene, effects={"range_eccentricity": {"cosine_m": 50}})
    shipped = source / "notebooks_data/scenes/field-layout-effects.yaml"
    command("simulate", shipped, "-o", tmp_path / "sim", "--seed", 4)
    np.testing.assert_array_equal(rangecal.simulate(shipped, 4).range_m, rangecal.load(tmp_path / "sim").range_m)


def test_a_layout_with_a_calibration(field, calibration):
    again = rangecal.simulate(field, 3, calibration=calibration)
    np.testing.assert_array_equal(again.stop, field.stop)
    assert not np.array_equal(again.range_m, field.range_m)
    np.testing.assert_array_equal(again.true_landmarks, calibration.landmarks)
    with pytest.raises(rangecal.InputError, match="takes a calibration"):
        rangecal.simulate(field)
