# SPDX-License-Identifier: BSD-3-Clause
import gc
import json
import pickle

import numpy as np
import pytest

import rangecal
from conftest import assert_same


@pytest.mark.parametrize("method", ["closed-form", "approximate", "full", "marginal"])
@pytest.mark.parametrize("name", ["field-layout", "pairs-2016"])
def test_results_are_those_of_the_program(name, method, source, command, tmp_path):
    folder = source / "notebooks_data" / name
    command("calibrate", folder, "--method", method, "--json", tmp_path / "cal.json")
    theirs = json.loads((tmp_path / "cal.json").read_text())
    assert_same(rangecal.calibrate(folder, method).to_dict(), theirs)


def test_two_recordings_share_a_sensor(source, command, tmp_path):
    folders = [source / "notebooks_data/field-layout", source / "notebooks_data/2021-setting"]
    command("calibrate", *folders, "--order", 2, "--noise", "f2", "--json", tmp_path / "cal.json")
    ours = rangecal.calibrate(folders, order=2, noise="f2")
    theirs = json.loads((tmp_path / "cal.json").read_text())
    assert theirs.pop("notes", []) == list(ours.notes)  # two sensors pooled: their noise has tails
    assert_same(ours.to_dict(), theirs)
    assert set(ours.landmark_recording) == {0, 1}
    assert len(ours.landmarks_to_frame()) == 10 and len(ours.stops_to_frame()) == 30


def test_tails_have_every_standard_deviation_or_none(field):
    # The readings were drawn with Gaussian noise: nu of the bearings ends at the top of its range, where it has none.
    calibration = rangecal.calibrate(field, order=2, noise="f2", noise_shape="student-t")
    shapes = calibration.noise_shapes
    assert shapes == calibration.to_dict()["noise"]["shapes"]
    assert set(shapes["range"]) == set(shapes["bearing"]) == {"family", "nu", "nu_std"}
    assert shapes["bearing"]["nu_std"] is None and shapes["range"]["nu_std"] > 0.0


def test_the_bound_is_that_of_the_file(calibration, diagnosis):
    bound = calibration.bound_alpha_std
    assert bound.shape == (calibration.order + 1,) and not bound.flags.writeable
    np.testing.assert_array_equal(bound, calibration.to_dict()["bound_alpha_std"])
    assert diagnosis.corrected.bound_alpha_std is None   # of a curve that effects go with


def test_arrays_are_views_that_keep_the_calibration_alive(field):
    calibration = rangecal.calibrate(field, order=2, noise="f2")
    alpha, covariance, landmarks = calibration.alpha, calibration.covariance, calibration.landmarks
    assert alpha.base is calibration and landmarks.base is calibration
    expected = [np.array(a) for a in (alpha, covariance, landmarks)]
    del calibration
    gc.collect()
    for array, values in zip((alpha, covariance, landmarks), expected):
        np.testing.assert_array_equal(array, values)
        assert not array.flags.writeable


def test_the_truth_is_near(calibration, field):
    # Scene: alpha = (0.0525, 0.8838, 0.0584), sigma_e = 0.01. Four standard deviations: 1 in 16000 per number.
    truth = np.array([0.0525, 0.8838, 0.0584])
    delta = calibration.alpha - truth
    assert delta @ np.linalg.solve(calibration.covariance, delta) < 21.1   # chi^2, 3 degrees of freedom, 1e-4
    assert abs(calibration.noise_parameters[0] - 0.01) < 4 * calibration.noise_std[0]
    errors = calibration.landmarks - field.true_landmarks
    for error, covariance in zip(errors, calibration.landmark_covariance):
        assert error @ np.linalg.solve(covariance, error) < 18.4           # chi^2, 2 degrees of freedom, 1e-4


def test_curve_and_noise_by_hand(calibration):
    a = calibration.alpha
    d = np.array([0.5, 1.0, 3.0])
    f = a[0] + a[1] * d + a[2] * d**2
    np.testing.assert_allclose(calibration.f(d), f, rtol=1e-14)
    C = calibration.covariance_with_choice
    assert C is not None                    # the order was chosen: the band says what that may cost
    phi = d ** np.arange(len(C))[:, None]
    np.testing.assert_allclose(calibration.f_std(d), np.sqrt(np.einsum("in,ij,jn->n", phi, C, phi)),
                               rtol=1e-9)   # cancellation between the coefficients costs digits
    given = np.sqrt(np.einsum("in,ij,jn->n", phi[:3], calibration.covariance, phi[:3]))
    assert np.all(calibration.f_std(d) > 0.9 * given)
    np.testing.assert_allclose(calibration.noise(d), calibration.noise_parameters[0] * f**2, rtol=1e-14)
    assert calibration.f(1.0) == pytest.approx(a.sum(), rel=1e-14)


def test_models_tried_and_frames(calibration):
    models = calibration.models_to_frame()
    assert models["order"][0] == calibration.order and models["noise_law"][0] == calibration.noise_law
    assert models["behind"][0] == 0.0
    frame = calibration.to_frame()
    assert list(frame.index) == ["alpha_0", "alpha_1", "alpha_2", "sigma_e", "sigma_theta"]
    assert list(frame["unit"]) == ["m", "", "1/m", "1/m", "rad"]
    np.testing.assert_allclose(frame["std"][:3], np.sqrt(np.diag(calibration.covariance)))


def test_compare(field):
    comparison = rangecal.compare(field)
    assert [c.method for c in comparison] == ["closed-form", "approximate", "full", "marginal"]
    frame = comparison.to_frame()
    assert frame.loc["AIC", "marginal"] == comparison["marginal"].aic
    assert frame.loc["MSE ratio"].min() > 10
    with pytest.raises(KeyError):
        comparison["best"]


def test_saved_and_refined(calibration, field, tmp_path):
    path = tmp_path / "cal.json"
    calibration.save(str(path))
    loaded = rangecal.load(path)
    assert_same(loaded.to_dict(), calibration.to_dict())
    refined = rangecal.calibrate(field, start=loaded)
    change = rangecal.compare_curves(loaded, refined)
    assert change.largest_m < 1e-6 and change.p_value > 0.99   # the same data give the same curve
    assert change.reason == "" and not change.given_the_model and change.noise_degrees_of_freedom > 100


def test_curves_of_different_orders_need_the_choice(field):
    one, two = (rangecal.calibrate(field, order=order, noise="f2") for order in (1, 2))
    change = rangecal.compare_curves(one, two)
    assert change.p_value is None and "orders differ (1 and 2)" in change.reason and change.largest_m > 0.01


def test_counts_are_those_of_the_file(calibration):
    assert calibration.counts == calibration.to_dict()["counts"] and calibration.counts["used"] > 0


def test_wrong_options_name_themselves(field):
    for options, message in (({"method": "best"}, "best"), ({"order": "two"}, "order is 'two'"),
                             ({"order": 99}, "99"), ({"noise": "pink"}, "pink"), ({"solver": "x"}, "'x'")):
        with pytest.raises(rangecal.InputError, match=message):
            rangecal.calibrate(field, **options)


def test_an_unlucky_solve_is_an_outcome():
    recording = rangecal.Recording(
        {"stop": [0, 1], "landmark": ["A", "A"], "range_m": [1.0, 2.0], "bearing_rad": [0.5, 0.4]},
        {"stop": [0, 1], "x_m": [0, 1], "y_m": [0, 0], "heading_rad": [0, 0]})
    calibration = rangecal.calibrate(recording)
    assert calibration.outcome == "too_few_data" and calibration.reason and not calibration.usable
    assert len(calibration.to_frame()) >= 0 and calibration.covariance is None
    with pytest.raises(rangecal.InputError, match="too_few_data"):
        rangecal.correct(calibration, 1.0)


def test_a_voltage_gets_a_reciprocal_curve(source):
    folder = source / "notebooks_data/everyday/reciprocal"
    ours = rangecal.calibrate(folder)
    assert ours.curve["family"] == "reciprocal" and ours.curve["offset_std_m"] > 0
    u = 1.0 / (2.0 + ours.curve["offset_m"])
    assert ours.f(2.0) == pytest.approx(np.polyval(ours.alpha[::-1], u))
    power = u ** np.arange(len(ours.covariance_with_choice))
    assert ours.f_std(2.0) == pytest.approx(np.sqrt(power @ ours.covariance_with_choice @ power))
    d = rangecal.correct(ours, [ours.f(2.0)]).distance_m
    assert d[0] == pytest.approx(2.0)
    assert rangecal.calibrate(folder, curve="polynomial").curve == {"family": "polynomial"}
    assert rangecal.diagnose(folder, curve="reciprocal", held_out=False).verdict == "no_mismatch"
    with pytest.raises(rangecal.InputError, match="d2"):
        rangecal.calibrate(folder, curve="reciprocal", noise="d2")


def test_a_spline_follows_the_same_voltage(source, tmp_path):
    folder = source / "notebooks_data/everyday/reciprocal"
    ours, known = rangecal.calibrate(folder, curve="spline"), rangecal.calibrate(folder)
    assert ours.curve["family"] == "spline" and 4 < ours.curve["degrees"] < 40
    assert np.all(np.diff(ours.curve["knots_m"]) > 0) and np.all(np.diff(ours.curve["values_m"]) > 0)
    at = np.linspace(0.4, 5.8, 12)
    assert np.all(np.abs(ours.f(at) - known.f(at)) < 4 * np.hypot(ours.f_std(at), known.f_std(at)))
    assert rangecal.correct(ours, [ours.f(2.0)]).distance_m[0] == pytest.approx(2.0)
    ours.save(tmp_path / "spline.json")
    for again in (rangecal.load(tmp_path / "spline.json"), pickle.loads(pickle.dumps(ours))):
        assert again.f(2.0) == ours.f(2.0) and again.f_std(2.0) == pytest.approx(ours.f_std(2.0))
    with pytest.raises(rangecal.InputError, match="no order"):
        rangecal.calibrate(folder, curve="spline", order=2)
