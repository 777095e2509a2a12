# SPDX-License-Identifier: BSD-3-Clause
import pytest
from matplotlib import pyplot

import rangecal


@pytest.fixture(autouse=True)
def close():
    yield
    pyplot.close("all")


def test_every_plot_draws_marks(field, pairs, calibration, diagnosis, eccentric):
    residuals = rangecal.residuals(eccentric, diagnosis.baseline, along=["sensor_bearing"])
    plots = [field.plot(), pairs.plot(), calibration.plot(), calibration.plot_scene(), rangecal.compare(pairs).plot(),
             rangecal.correct(calibration, field).plot(), diagnosis.plot(), residuals.plot(),
             residuals.plot("sensor_bearing", "bearing")]
    for ax in plots:
        assert ax.lines and ax.get_xlabel() and ax.get_ylabel()
        ax.figure.canvas.draw()
    with pytest.raises(ValueError, match="along is 'moon'"):
        residuals.plot("moon")
    with pytest.raises(rangecal.InputError, match="channel is 'moon', not range or bearing"):
        residuals.plot(channel="moon")
    with pytest.raises(rangecal.InputError, match="bins is 0"):
        residuals.plot(bins=0)


def test_axes_are_taken(calibration):
    _, ax = pyplot.subplots()
    assert calibration.plot(ax) is ax


def test_notebook_display(field, pairs, calibration, diagnosis, tmp_path):
    calibration.save(str(tmp_path / "cal.json"))
    kept = rangecal.load(tmp_path / "cal.json")   # a summary speaks of the recordings too; this one has its parameters
    for result, word in ((field, "500 readings"), (pairs, "600 pairs"), (calibration, "Curve f"), (kept, "alpha_2"),
                         (rangecal.compare(pairs), "Trust marginal"), (diagnosis, "range_eccentricity.amplitude"),
                         (rangecal.correct(calibration, field.range_m), "the first 10 of 500 readings"),
                         (rangecal.residuals(field, calibration), "bearing"), (rangecal.residuals(pairs, rangecal.calibrate(pairs)), "mm")):
        assert word in result._repr_html_()
        assert repr(result).startswith("<rangecal.")
    assert "<script" not in diagnosis._repr_html_()


def test_labels_are_escaped():
    recording = rangecal.Recording(pairs={"true_m": [1.0], "reading_m": [1.0]}, sensor={"name": "<b>x</b>"})
    assert "<b>x" not in recording._repr_html_().split(":", 1)[1]
