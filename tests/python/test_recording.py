# SPDX-License-Identifier: BSD-3-Clause
import gc
import pickle

import numpy as np
import pandas
import pytest

import rangecal


def test_arrays_are_read_only_views_that_keep_the_recording_alive(source):
    recording = rangecal.load(source / "notebooks_data/field-layout")
    ranges, stops, radius = recording.range_m, recording.stops, recording.landmark_radius_m
    assert ranges.base is recording and stops.base is recording
    assert np.shares_memory(ranges, recording.range_m)
    kept = ranges.copy(), stops.copy()
    del recording
    gc.collect()
    np.testing.assert_array_equal(ranges, kept[0])
    np.testing.assert_array_equal(stops, kept[1])
    np.testing.assert_array_equal(radius, np.full(5, 0.12))
    with pytest.raises(ValueError):
        ranges[0] = 0.0


def test_shapes(field, pairs):
    assert len(field) == 500 and field.kind == "landmarks"
    assert field.stops.shape == (10, 3) and field.true_stops.shape == (10, 3) and field.true_landmarks.shape == (5, 2)
    for name in ("stop", "landmark", "repeat", "range_m", "bearing_rad", "row"):
        assert getattr(field, name).shape == (500,), name
    assert field.row[0] == 2 and field.time_s is None and field.batch is None and field.true_m is None
    assert len(pairs) == 600 and pairs.kind == "pairs" and pairs.batch.max() == 11 and pairs.stop is None
    assert pairs.true_landmarks is None


def test_a_data_frame_makes_the_same_recording(field):
    landmarks = pandas.DataFrame({"landmark": field.landmark_labels, "radius_m": field.landmark_radius_m})
    again = rangecal.Recording(field.to_frame(), field.stops_to_frame(), landmarks,
                               sensor={"range_min_m": 0.1, "range_max_m": 10.0})
    np.testing.assert_array_equal(again.range_m, field.range_m)
    np.testing.assert_array_equal(again.bearing_rad, field.bearing_rad)
    np.testing.assert_array_equal(again.stops, field.stops)
    assert again.landmark_labels == field.landmark_labels and again.counts == field.counts
    assert again.sensor.range_max_m == 10.0


def test_how_scans_were_cut_is_kept(field, tmp_path):
    told = {"arc": "mean", "source": "run.csv", "radius_m": [0.04, 0.12]}
    again = rangecal.Recording(field.to_frame(), field.stops_to_frame(), extraction=told)
    assert again.extraction == {"arc": "mean", "source": "run.csv", "radius_m": "[0.04, 0.12]"}
    again.save(str(tmp_path / "rec"))
    assert rangecal.load(tmp_path / "rec").extraction == again.extraction
    assert field.extraction == {}


def test_arrays_make_pairs(pairs):
    again = rangecal.Recording(pairs={"true_m": pairs.true_m, "reading_m": pairs.range_m, "batch": pairs.batch})
    np.testing.assert_array_equal(again.range_m, pairs.range_m)
    np.testing.assert_array_equal(again.batch, pairs.batch)


def test_covariates_missing_values_and_labels():
    stops = {"stop": ["a", "b"], "x_m": [0, 1], "y_m": [0.0, 0.0], "heading_rad": [0.0, 0.0]}
    observations = pandas.DataFrame({
        "stop": ["a", "a", "b", "b"], "landmark": ['L "1", red', "L2", 'L "1", red', "L2"],
        "range_m": [1.0, np.nan, 0.0, 3.5], "bearing_rad": [0.1, 0.2, 0.3, 0.4], "intensity": [7.0, 8.0, 9.0, None]})
    recording = rangecal.Recording(observations, stops, sigma_xy_m="estimate", stop_error="random_walk")
    assert recording.counts == {"read": 4, "used": 2, "dropped": {"missing": 1, "zero": 1}, "cells_left_out": 0}
    assert recording.landmark_labels == ['L "1", red', "L2"]
    np.testing.assert_array_equal(recording.covariates["intensity"], [7.0, np.nan])
    assert recording.sigma_xy_m == "estimate" and recording.stop_error == "random_walk"
    np.testing.assert_array_equal(recording.row, [2, 5])


def test_a_column_left_out_is_noted(field):
    observations = field.to_frame()
    observations["temperature_c"] = ["20.5"] * 16 + ["warm"] + ["21"] * (len(field) - 17)
    recording = rangecal.Recording(observations, field.stops_to_frame())
    assert "temperature_c" not in recording.covariates and field.notes == []
    assert recording.notes == ["observations.csv, row 18, column 'temperature_c': 'warm' is not a number; the column is left out"]
    assert pickle.loads(pickle.dumps(recording)).notes == recording.notes
    assert recording.notes[0] in rangecal.calibrate(recording, "closed-form", order=2, noise="f2").notes
    with pytest.raises(AttributeError):
        recording.notes = []


def test_saved_and_loaded(field, tmp_path):
    field.save(str(tmp_path / "copy"))
    again = rangecal.load(tmp_path / "copy")
    np.testing.assert_array_equal(again.range_m, field.range_m)
    np.testing.assert_array_equal(again.true_landmarks, field.true_landmarks)


@pytest.fixture
def measured(tmp_path):
    """A folder that no program made."""
    folder = tmp_path / "measured"
    folder.mkdir()
    (folder / "recording.yaml").write_text("format: rangecal/1\nkind: pairs\n")
    (folder / "pairs.csv").write_text("true_m,reading_m\n1,1.01\n")
    return folder


def test_a_measured_recording_is_not_replaced(source, measured, tmp_path):
    simulated = rangecal.simulate(source / "notebooks_data/scenes/pairs-2016.yaml", 1)
    with pytest.raises(rangecal.InputError, match="measured: holds a recording that is not a simulated .* would be lost"):
        simulated.save(measured)
    with pytest.raises(rangecal.InputError, match="overwrite is 'no'"):
        simulated.save(measured, overwrite="no")
    assert (measured / "pairs.csv").read_text() == "true_m,reading_m\n1,1.01\n"
    simulated.save(measured, overwrite=True)
    assert len(rangecal.load(measured)) == len(simulated) > 1


def test_what_a_program_made_is_replaced(source, calibration, field, tmp_path):
    scene, folder = source / "notebooks_data/scenes/pairs-2016.yaml", tmp_path / "sim"
    for made in (rangecal.simulate(scene, 1), pickle.loads(pickle.dumps(rangecal.simulate(scene, 2))),
                 rangecal.simulate(field, 3, calibration=calibration), rangecal.simulate(scene, 4)):
        made.save(folder)
        assert (folder / "recording.yaml").read_text().startswith("# made by rangecal simulate\n")
        np.testing.assert_array_equal(rangecal.load(folder).range_m, made.range_m)
    mine = rangecal.Recording(pairs={"true_m": [1.0], "reading_m": [1.0]})
    mine.save(folder)
    with pytest.raises(rangecal.InputError, match="would be lost"):   # of tables nobody knows who made them
        mine.save(folder)


def test_results_do_not_replace_measurements(measured, calibration, diagnosis):
    for result in (calibration, diagnosis):
        with pytest.raises(rangecal.InputError, match="pairs.csv: is a table of a recording, and would be lost"):
            result.save(measured / "pairs.csv")
    assert (measured / "pairs.csv").read_text() == "true_m,reading_m\n1,1.01\n"


def test_a_constructor_that_threw_can_be_shown():
    assert repr(rangecal.Recording.__new__(rangecal.Recording)) == "<rangecal.Recording: not made>"


def test_masked_values_are_missing():
    hidden = np.ma.masked_array([1.0, 2.0, 3.0], mask=[False, True, False])
    recording = rangecal.Recording(pairs={"true_m": [1.0, 2.0, 3.0], "reading_m": hidden})
    np.testing.assert_array_equal(recording.range_m, [1.0, 3.0])


@pytest.mark.parametrize("change, message", [
    ({"bearing_rad": [100.0, 0.0]}, "observations.csv, row 2, column 'bearing_rad': '100' is beyond"),
    ({"stop": ["a", "c"]}, "observations.csv, row 3, column 'stop': unknown stop 'c'"),
    ({"range_m": [1.0]}, "observations.csv, column 'range_m': has 1 entries, where 'stop' has 2"),
    ({"range_m": [[1.0], [2.0]]}, "observations.csv, column 'range_m': is not one-dimensional"),
    ({"range_m": [[1.0], [2.0, 3.0]]}, "observations.csv, column 'range_m': is not one-dimensional"),
])
def test_wrong_tables_say_where(change, message):
    observations = {"stop": ["a", "a"], "landmark": ["L", "M"], "range_m": [1.0, 2.0], "bearing_rad": [0.0, 0.1]}
    with pytest.raises(rangecal.InputError) as error:
        rangecal.Recording({**observations, **change},
                           {"stop": ["a"], "x_m": [0.0], "y_m": [0.0], "heading_rad": [0.0]})
    assert str(error.value).startswith(message)


def test_input_errors_are_value_errors_with_the_message_of_the_program(source, tmp_path):
    with pytest.raises(ValueError, match="no such folder"):
        rangecal.load(tmp_path / "none")
    with pytest.raises(rangecal.InputError, match="needs observations and stops, or pairs"):
        rangecal.Recording()
    with pytest.raises(rangecal.InputError, match="either pairs, or"):
        rangecal.Recording({}, {}, pairs={})
    with pytest.raises(rangecal.InputError, match="take no true_stops"):
        rangecal.Recording(pairs={"true_m": [1.0], "reading_m": [1.0]}, true_landmarks={"landmark": ["A"]})
    with pytest.raises(rangecal.InputError, match="several columns have one name"):
        rangecal.Recording(pairs=pandas.DataFrame([[1.0, 1.0, 2.0]], columns=["true_m", "reading_m", "reading_m"]))
    with pytest.raises(ValueError, match="surrogates not allowed"):
        rangecal.Recording(pairs={"true_m": [1.0], "reading_m": [1.0], "batch": ["\udcff"]})


def test_what_a_column_measures_can_be_said(tmp_path):
    rng = np.random.default_rng(4)
    true_m, warmth = rng.uniform(0.5, 5.0, 300), rng.uniform(5.0, 35.0, 300)
    reading_m = 1.01 * true_m + 0.004 * (warmth - 20.0) + rng.normal(0.0, 0.01, 300)
    pairs = {"true_m": true_m, "reading_m": reading_m, "warmth": warmth}
    said = rangecal.Recording(pairs=pairs, columns={"warmth": {"role": "temperature", "unit": "degC"}})
    assert rangecal.diagnose(said).final_effects == ["temperature_coefficient:warmth"]
    assert rangecal.diagnose(rangecal.Recording(pairs=pairs)).final_effects == ["covariate_drift:warmth"]
    said.save(tmp_path / "rec")
    assert rangecal.diagnose(rangecal.load(tmp_path / "rec")).final_effects == ["temperature_coefficient:warmth"]
    with pytest.raises(rangecal.InputError, match="'warm', not one of received_power, temperature"):
        rangecal.Recording(pairs=pairs, columns={"warmth": {"role": "warm"}})
