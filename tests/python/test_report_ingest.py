# SPDX-License-Identifier: BSD-3-Clause
"""Reports, raw scans, published data sets, pickling."""
import copy
import dataclasses
import locale
import multiprocessing
import os
import pathlib
import pickle
import subprocess
import sys

import numpy as np
import pandas
import pytest
from conftest import scans_of

import rangecal

sys.path.append(str(pathlib.Path(__file__).parents[2] / "notebooks_data"))
import stand_in_bag  # noqa: E402


def write(result, path):
    """The page, or a skip where this build has no charting library."""
    try:
        result.report(path)
    except rangecal.InputError as error:
        if "no charting library" in str(error):
            assert not path.exists()
            pytest.skip(str(error))
        raise
    return path.read_text()


def test_reports_are_those_of_the_program(source, field, calibration, diagnosis, command, tmp_path):
    page = write(calibration, tmp_path / "calibration.html")
    assert "The curve f" in page and "</html>" in page
    assert "What to record next" in write(diagnosis, tmp_path / "diagnosis.html")
    assert "marginal" in write(rangecal.compare(field), tmp_path / "comparison.html")
    command("diagnose", source / "notebooks_data/pairs-2016", "--report", tmp_path / "theirs.html")
    ours = write(rangecal.diagnose(source / "notebooks_data/pairs-2016"), tmp_path / "ours.html")
    assert ours == (tmp_path / "theirs.html").read_text()
    quick = rangecal.study(source / "notebooks_data/studies/quick.yaml", repeats=2)
    assert quick.name in write(quick, tmp_path / "study.html")


def test_the_file_for_viewers_is_that_of_the_program(source, command, tmp_path):
    recording = source / "notebooks_data/pairs-2016"
    command("diagnose", recording, "--mcap", tmp_path / "theirs.mcap")
    rangecal.diagnose(recording).mcap(tmp_path / "ours.mcap")
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()
    with pytest.raises(rangecal.InputError, match="cannot be written"):
        rangecal.diagnose(recording, held_out=False).mcap("/dev/null")


def test_a_calibration_from_a_file_has_no_report(calibration, tmp_path):
    calibration.save(str(tmp_path / "cal.json"))
    with pytest.raises(rangecal.InputError, match="takes a calibration made by"):
        rangecal.load(tmp_path / "cal.json").report(tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_scans_in_memory_become_a_recording(tmp_path):
    cylinders = [(1.0, 1.5), (2.2, -1.3), (-1.1, 1.2), (0.4, -1.8)]
    places = [(0.0, 0.0), (0.4, 0.0), (0.8, 0.0), (1.2, 0.1)]
    stops = {"stop": list("0123"), "x_m": [p[0] for p in places], "y_m": [p[1] for p in places],
             "heading_rad": np.zeros(4)}
    found = rangecal.extract(scans_of(cylinders, places), stops, radius_m=0.1, arc="mean", sigma_xy_m=0.01,
                             sigma_heading_rad=0.0, name="made up")
    recording = found.recording
    assert len(recording.landmark_labels) == 4 and len(recording) == 16
    assert recording.sensor.name == "made up" and recording.extraction["arc"] == "mean" == found.arc
    assert found.counts["cylinders"]["used"] == 16 and found.counts["segments"]["wall"] > 0
    frame = found.to_frame()
    for x, y in cylinders:   # stops are exact, a beam errs by a millimetre; fitted over some ten of them
        assert np.hypot(frame.x_m - x, frame.y_m - y).min() < 0.005
    assert "walls" in found.text and "<pre>" in found._repr_html_() and "doubtful" not in found.text
    recording.save(str(tmp_path / "rec"))
    assert rangecal.load(tmp_path / "rec").extraction == recording.extraction


def test_a_landmark_seen_from_one_stop_is_called_doubtful():
    found = rangecal.extract(scans_of([(1.0, 1.5)], [(0.0, 0.0)], beams=1440), radius_m=0.1)
    assert len(found.recording.landmark_labels) == 1 and "doubtful   L1: seen from one stop" in found.text


def test_extraction_says_what_is_wrong_and_what_is_not_there(tmp_path):
    empty = rangecal.extract(scans_of([], [(0.0, 0.0)]))
    assert empty.recording is None and len(empty.to_frame()) == 0
    with pytest.raises(rangecal.InputError, match="not one of nearest, mean, smallest"):
        rangecal.extract(scans_of([], [(0.0, 0.0)]), arc="far")
    with pytest.raises(rangecal.InputError, match="none.csv"):
        rangecal.extract(tmp_path / "none.csv")


def test_a_log_that_was_cut_off_warns_in_the_line_of_the_call(tmp_path):
    scans = scans_of([(1.0, 1.5)], [(0.0, 0.0)] * 3, beams=180)
    ranges_m = np.nan_to_num(scans["range_m"], neginf=0.0)   # along the walls; 0 is no echo
    lines = []
    for k in range(3):
        ranges = " ".join(f"{r:.3f}" for r in ranges_m[180 * k:180 * (k + 1)])
        lines.append(f"FLASER 180 {ranges} 0 0 0 0 0 0 {k} host {k}\n")
    log = tmp_path / "robot.log"
    log.write_text("".join(lines)[:-200])
    with pytest.warns(UserWarning, match="robot.log, row 3: the last line is torn") as caught:
        rangecal.extract(log, radius_m=0.1, split="scan")
    assert [pathlib.Path(warning.filename).name for warning in caught] == [pathlib.Path(__file__).name]


def test_a_program_that_has_decimal_commas(tmp_path, monkeypatch, source):
    made = subprocess.run(["localedef", "-c", "-i", "de_DE", "-f", "UTF-8", tmp_path / "de_DE.UTF-8"], capture_output=True, check=False)
    if made.returncode and not (tmp_path / "de_DE.UTF-8/LC_NUMERIC").exists():
        pytest.skip("no German locale can be made here (Debian: locales)")
    places = [(0.0, 0.0), (0.3, 0.1), (0.6, -0.2)]
    scans = scans_of([(1.0, 1.0), (2.0, -1.0), (-1.5, 0.5)], places)
    stops = {"stop": ["0", "1", "2"], "x_m": [x for x, _ in places], "y_m": [y for _, y in places], "heading_rad": [0.0] * 3}

    def extracted():
        return rangecal.extract(scans, stops, radius_m=0.1, sigma_xy_m=0.01)

    field = source / "notebooks_data/field-layout"
    plain = extracted(), rangecal.calibrate(field, "full", order=2)
    before = locale.setlocale(locale.LC_ALL)
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    try:
        locale.setlocale(locale.LC_ALL, "de_DE.UTF-8")
        assert locale.str(1.5) == "1,5"
        german = extracted(), rangecal.calibrate(field, "full", order=2)
    finally:
        locale.setlocale(locale.LC_ALL, before)
    np.testing.assert_array_equal(german[0].recording.range_m, plain[0].recording.range_m)
    np.testing.assert_array_equal(german[1].alpha, plain[1].alpha)


def test_published_data_sets(source):
    folder = pathlib.Path(os.environ.get("RANGECAL_RECORDINGS", source / "../shared/recordings"))
    if not folder.exists():
        required = os.environ.get("RANGECAL_REQUIRE_DATA", "") not in ("", "0")
        (pytest.fail if required else pytest.skip)(f"missing recording {folder}")
    robot = rangecal.import_lego(folder / "brenner-lego")
    np.testing.assert_array_equal(robot.landmark_radius_m, np.full(6, 0.055))
    assert robot.extraction["arc"] == "nearest"
    pairs = rangecal.import_mrclam(folder / "mrclam6", 2, kind="pairs")
    assert pairs.kind == "pairs" and len(pairs) > 1000
    with pytest.raises(rangecal.InputError, match="robot"):
        rangecal.import_mrclam(folder / "mrclam6", 9)


def test_a_table_is_a_recording_of_pairs(tmp_path):
    table = tmp_path / "t.csv"
    table.write_text("tape [cm];sonar;room\n57,0;0,571;21\n100;ERR;21\n150;-;21\n200;2,01;22\n", encoding="utf-8")
    pairs = rangecal.import_dataset("csv", table, true="tape [cm]", reading="sonar", missing=["ERR", "oops"])
    assert pairs.kind == "pairs" and pairs.sensor.unit == "" and len(pairs) == 2
    np.testing.assert_array_equal(pairs.true_m, [0.57, 2.0])
    np.testing.assert_array_equal(pairs.range_m, [0.571, 2.01])
    with pytest.warns(UserWarning, match="in another unit"):
        rangecal.import_dataset("csv", table, true="tape [cm]", reading="sonar", reading_unit="mm", missing="ERR")
    with pytest.raises(rangecal.InputError, match="did you mean 'sonar'"):
        rangecal.import_dataset("csv", table, true="tape [cm]", reading="Sonra")


def test_an_unknown_data_set_is_an_error():
    with pytest.raises(rangecal.InputError, match="known: csv, lego, mrclam"):
        rangecal.import_dataset("moon", "nowhere")


def test_results_pickle_to_the_last_bit(field, pairs, calibration, diagnosis):
    for recording in (field, pairs):
        again = pickle.loads(pickle.dumps(recording))
        np.testing.assert_array_equal(again.range_m, recording.range_m)
        assert again.counts == recording.counts and again.path == recording.path
    again = copy.deepcopy(calibration)
    assert again.to_json() == calibration.to_json() and len(again.models) == len(calibration.models)
    np.testing.assert_array_equal(again.covariance, calibration.covariance)
    again = pickle.loads(pickle.dumps(diagnosis))
    assert again.to_json() == diagnosis.to_json()
    assert [p.name for p in again.explanations[0].parameters] == [p.name for p in diagnosis.explanations[0].parameters]
    np.testing.assert_array_equal(again.simulate_all(3)[0].range_m, diagnosis.simulate_all(3)[0].range_m)
    residuals = rangecal.residuals(field, calibration, along=["time"])
    assert pickle.loads(pickle.dumps(residuals)).to_frame().equals(residuals.to_frame())
    change = rangecal.compare_curves(calibration, rangecal.calibrate(field, "closed-form"))
    again = copy.copy(change)
    assert (again.rms_m, again.p_value, again.degrees_of_freedom) == (change.rms_m, change.p_value, change.degrees_of_freedom)
    comparison = rangecal.compare(field, methods=["closed-form", "marginal"])
    assert pickle.loads(pickle.dumps(comparison)).to_frame().equals(comparison.to_frame())


def test_work_in_other_processes(field):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        there = pool.map(rangecal.calibrate, [field])[0]
    assert there.alpha.tolist() == rangecal.calibrate(field).alpha.tolist()


def test_damaged_bytes_are_refused(field):
    version, data, more = field.__reduce_ex__(2)[2]
    for state in ((version, data[:-3], more), (version, data + b"x", more), ("0.0.0", data, more)):
        with pytest.raises(rangecal.InputError, match="pickled"):
            rangecal.Recording.__new__(rangecal.Recording).__setstate__(state)


def mcap_of(scans):
    """A table of scans as an MCAP file."""
    messages = []
    for stamp, one in pandas.DataFrame(scans).groupby("stamp"):
        angles = one.angle_rad.to_numpy()
        messages.append(("/scan", stamp, stand_in_bag.laser_scan(stamp, angles[0], angles[1] - angles[0], one.range_m.to_numpy())))
    return stand_in_bag.mcap({"/scan": "sensor_msgs/msg/LaserScan"}, messages)


def test_load_reads_a_bag_as_extract_does(tmp_path):
    places = [(0.0, 0.0)] * 6                                   # the robot stands
    scans = scans_of([(1.2, 1.5), (-1.0, 0.8), (0.3, -1.4)], places, beams=1440)
    del scans["stop"]
    bag = tmp_path / "run.mcap"
    bag.write_bytes(mcap_of(scans))
    loaded = rangecal.load(bag, radius_m=0.1)
    assert len(loaded.landmark_labels) == 3 and len(loaded) == 18
    pandas.testing.assert_frame_equal(loaded.to_frame(), rangecal.extract(bag, radius_m=0.1).recording.to_frame())
    table = rangecal.extract(scans, radius_m=0.1).recording
    assert np.max(np.abs(np.sort(loaded.range_m) - np.sort(table.range_m))) < 1e-6      # float32 in the bag
    folder = tmp_path / "rosbag2"
    folder.mkdir()
    (folder / "run_0.mcap").write_bytes(bag.read_bytes())
    assert len(rangecal.load(folder, topic="/scan", radius_m=0.1)) == 18
    (tmp_path / "empty.mcap").write_bytes(mcap_of(scans_of([], places)))
    with pytest.raises(rangecal.InputError, match="no landmark was found"):
        rangecal.load(tmp_path / "empty.mcap")
    with pytest.raises(rangecal.InputError, match="/none"):
        rangecal.load(bag, topic="/none")
    with pytest.raises(TypeError, match="group_by"):
        rangecal.load(bag, group_by="stop")


def test_load_takes_no_options_of_a_bag_for_a_recording(source):
    with pytest.raises(TypeError, match="topic: of a bag"):
        rangecal.load(source / "notebooks_data/field-layout", topic="/scan")


def test_a_bag_is_corrected_as_the_program_does(calibration, command, tmp_path):
    scans = scans_of([(1.2, 1.5), (-1.0, 0.8), (0.3, -1.4)], [(0.0, 0.0)] * 3, beams=720)
    bag, saved = tmp_path / "run.mcap", tmp_path / "cal.json"
    bag.write_bytes(mcap_of(scans))
    calibration.save(saved)
    command("correct", saved, bag, "-o", tmp_path / "theirs.mcap", "--keep-raw", "/raw")
    stages = []
    done = rangecal.correct_bag(saved, bag, tmp_path / "ours.mcap", keep_raw="/raw", progress=lambda *told: stages.append(told))
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()
    assert done.topic == "/scan" and done.messages == 3 and done.readings == 3 * 720
    assert done.corrected + done.kept + done.without_distance == done.readings and done.corrected > 0
    assert "corrected" in repr(done) and stages[-1][1] <= 1.0
    again = rangecal.correct_bag(calibration, str(bag), tmp_path / "object.mcap")
    assert again == dataclasses.replace(done, format=again.format)
    for wrong, words in (((tmp_path / "none.mcap", tmp_path / "out.mcap"), "none.mcap"), ((bag, bag), "run.mcap"),
                         ((bag, tmp_path / "no/folder.mcap"), "no")):
        with pytest.raises(rangecal.InputError, match=words):
            rangecal.correct_bag(calibration, *wrong)
    with pytest.raises(rangecal.InputError, match="/none"):
        rangecal.correct_bag(calibration, bag, tmp_path / "out.mcap", topic="/none")
    with pytest.raises(TypeError, match="calibration"):
        rangecal.correct_bag(3.0, bag, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()
