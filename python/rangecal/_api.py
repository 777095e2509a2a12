# SPDX-License-Identifier: BSD-3-Clause
"""The functions of the package. Each checks and shapes its arguments and calls the C++ library."""
import json
import os
from collections.abc import Mapping

import numpy as np

from . import _ingest, _native, _take
from ._native import Calibration, Diagnosis, Recording
from ._recording import columns_of, is_table, made_by, names_of_columns
from ._results import Comparison, Corrected, Study

_COLUMNS = ("bearing_rad", "heading_rad", "time_s", "radius_m", "landmark", "stop", "repeat")   # docs/diagnosis.md
_COVARIATES = ("range", "disparity", "sensor_bearing", "heading", "time", "stop", "repeat", "landmark",
               "radius")   # docs/formats.md


def load(path, *, group_by=(), **options):
    """Read a recording, a calibration, or the cylinders in a bag's scans.

    Parameters
    ----------
    path : str or os.PathLike
        A recording's folder (``recording.yaml`` and CSV tables), a calibration file
        (``rangecal-calibration/1`` JSON; of several methods in it the best usable one), or a bag: MCAP, an SQLite file of
        rosbag2, a folder of these (``docs/bags.md``).
    group_by : str or list of str
        Columns of a recording that say which readings belong together, in place of those that it states itself.
    **options
        Of a bag those of `extract`: ``topic, odometry_topic, stops, radius_m``, ...

    Returns
    -------
    Recording or Calibration
        Of a bag what ``extract(path, **options).recording`` is.

    Raises
    ------
    InputError
        Naming file, row and column of what cannot be used; of a bag in which no landmark was found, saying what was.
    """
    path = _take.path("path", path)
    if not os.path.exists(os.path.join(path, "recording.yaml")) and os.path.exists(path) and _holds_scans(path):
        if group_by:
            raise TypeError("group_by: the scans of a bag have no columns to group by")
        found = _ingest.extract(path, **options)
        if found.recording is None:
            raise _native.InputError(f"{path}: no landmark was found\n{found.text}")
        return found.recording
    if options:
        raise TypeError(f"{', '.join(options)}: of a bag, and {path} is none")
    if os.path.isfile(path):
        if group_by:
            raise TypeError("group_by: a calibration has no readings to group")
        return _native.load_calibration(path)
    return _native.load_recording(path, names_of_columns(group_by))


def _holds_scans(path):
    """Whether a file is a bag, or a folder holds any."""
    if os.path.isfile(path):
        return _native.is_bag(path)
    return any(name == "metadata.yaml" or name.endswith((".mcap", ".db3")) for name in os.listdir(path))


def calibrate(recordings, method="marginal", *, order="auto", curve="auto", noise="auto", noise_shape="auto",
              solver="block", weights="consistent", check=False, start=None, progress=None):
    """Estimate the curve f, the noise law, stops and landmarks by one method.

    The sensor reports ``y = f(d) + s(d) e`` at the true distance ``d`` to a landmark's surface.

    Parameters
    ----------
    recordings : Recording, path, or list of these
        Several recordings share one sensor.
    method : {"marginal", "full", "approximate", "closed-form"}
        ``"marginal"`` integrates the uncertain stops out and is recommended.
    order : int or "auto"
        Order of f; ``"auto"`` tries 1 to 4 and keeps the lowest AIC.
    curve : {"auto", "polynomial", "reciprocal", "spline"}
        What f is, of known distances (pairs): a polynomial in the distance d; one in 1 / (d + c) with an unknown c, as a sensor
        reads that gives a voltage or a disparity; or a smooth curve that rises or falls everywhere, with no order. ``"auto"``:
        d, but where readings fall with distance the better of the first two by AIC, and a spline where low orders do not.
    noise : {"auto", "constant", "f", "f2", "f3", "d2", "polynomial"}
        How the standard deviation s [m] of one reading depends on f; ``"auto"`` tries the first four.
    noise_shape : {"auto", "gaussian", "student-t", "contaminated", "one-sided"}
        Outliers: the density of the noise, for ``"full"`` and ``"marginal"``. ``"auto"`` chooses by AIC, of ranges and of
        bearings for themselves, and lets the closed forms see the readings that agree with most others; ``"gaussian"``
        takes all readings as they are.
    solver : {"block", "ceres"}
        Program for the full likelihood; both reach the same optimum.
    weights : {"consistent", "paper", "printed"}
        Of the closed form's lines of sight.
    check : bool
        Solve the full likelihood a second time with NLopt.
    start : Calibration or path, optional
        Refine this calibration: start from its curve, noise and landmarks.
    progress : callable, optional
        ``progress(stage, fraction)``, told what begins.

    Returns
    -------
    Calibration
        Also where the work could not deliver: see its ``outcome`` and ``reason``. ``models`` holds the orders and
        noise laws tried, ``notes`` what was done to the input.

    Raises
    ------
    InputError
        For an option or a recording that cannot be used.
    """
    comparison = _calibrate(recordings, [str(method)], order, curve, noise, noise_shape, solver, weights, check, start, progress)
    return comparison.calibrations[0]


def compare(recordings, *, methods=("closed-form", "approximate", "full", "marginal"), order="auto", curve="auto", noise="auto",
            noise_shape="auto", solver="block", weights="consistent", check=False, progress=None):
    """Calibrate by several methods side by side, with errors against ground truth where there is any.

    Parameters are those of `calibrate`; `methods` are the methods wanted, in their order, or one alone. Order and noise
    law are chosen once and shared by all methods.

    Returns
    -------
    Comparison
        ``calibrations`` and ``scores`` by method; ``to_frame()`` is the table that ``rangecal compare`` prints.
    """
    return _calibrate(recordings, _take.texts(methods), order, curve, noise, noise_shape, solver, weights, check, None, progress)


def _calibrate(recordings, methods, order, curve, noise, noise_shape, solver, weights, check, start, progress):
    def unless_auto(take, value):
        return None if value is None or isinstance(value, str) and value == "auto" else take(value)

    recordings = _take.recordings("recordings", recordings)
    return Comparison(_native.calibrate_job(
        recordings, methods, unless_auto(lambda o: _take.whole("order", o), order), unless_auto(str, curve),
        unless_auto(str, noise),
        str(noise_shape), str(solver), str(weights), _take.flag("check", check),
        None if start is None else _take.calibration("start", start), _take.progress(progress)), recordings)


def correct(calibration, readings, *, roots="ls", **columns):
    """Turn raw readings into distances with standard deviations.

    Parameters
    ----------
    calibration : Calibration or path
    readings : float, array_like (n,), table or Recording
        Raw readings [m]; of a table (pandas.DataFrame, dict, structured array) the column ``reading_m`` or ``range_m``.
    roots : {"ls", "ml"}
        ``"ls"``: distances where f(d) is the reading; ``"ml"``: the most likely distances.
    **columns : array_like (n,), or one value for all readings
        What the effects of the calibration depend on: ``bearing_rad``, ``heading_rad``, ``time_s``, ``radius_m``,
        ``landmark``, ``stop``, ``repeat``, or a covariate that one of them needs (``temperature_c``). Taken from
        `readings` where that is a table or a recording; None: not given.

    Returns
    -------
    Corrected
        ``distance_m`` and ``std_m`` of shape (n,), the most likely distance of each reading, NaN where there is none;
        ``flag`` says why; ``to_frame()`` lists every distance that explains a reading.

    Raises
    ------
    InputError
        Where the calibration has no curve, a column that one of its effects needs is missing, or one is given that is
        not known or not as long as the readings.
    """
    calibration = _take.calibration("calibration", calibration)
    table = {}
    if isinstance(readings, Recording):
        table, readings = readings.columns(), readings.range_m
    elif is_table(readings):
        table = columns_of("readings", readings)
        name = "reading_m" if "reading_m" in table else "range_m"
        if name not in table:
            raise _native.InputError("readings: there is no column reading_m or range_m")
        readings = table[name]
    values = np.atleast_1d(_take.numbers("readings", readings))
    if values.ndim != 1:
        raise _native.InputError("readings are not one-dimensional")
    if columns:
        known = list(dict.fromkeys(("roots", *_COLUMNS, *_native.columns_needed(calibration))))
        for name in columns:
            _take.known("correct: the keyword", name, known)
        table.update({name: _take.column(name, column, len(values)) for name, column in columns.items()
                      if column is not None})
    return Corrected(values, _native.correct_readings(calibration, values, table, str(roots)))


def simulate(scene, seed=1, *, calibration=None, effects=None):
    """Draw a recording, with its ground truth, from a scene or from a model.

    Parameters
    ----------
    scene : path, dict, Diagnosis, Recording or list of Recording
        A scene file, or its contents as a dictionary (``docs/scene.md``); a diagnosis, whose recordings are drawn anew
        from the model that it stands by; or recordings that say who is read when and from where, together with a
        `calibration`.
    seed : int
        The same seed gives the same recording.
    calibration : Calibration or path, optional
        Curve, noise, landmarks and effects, for recordings as `scene`.
    effects : dict of dict, optional
        Catalogued effects to add, by id and parameter: ``{"range_offset": {"offset_m": 0.02}}``. `effects()` lists
        them.

    Returns
    -------
    Recording, or list of Recording where the model has several
    """
    effects = _take.effects(effects)
    if isinstance(scene, Diagnosis):
        if effects or calibration is not None:
            raise _native.InputError("a diagnosis is simulated with its own calibration and effects")
        drawn = scene.simulate_all(seed)
        return drawn[0] if len(drawn) == 1 else drawn
    seed = _take.seed(seed)
    if isinstance(scene, (Recording, list, tuple)):
        if calibration is None:
            raise _native.InputError("simulating a recording's layout takes a calibration")
        drawn = _native.simulate_layout(_take.recordings("scene", scene), _take.calibration("calibration", calibration),
                                        effects, seed)
        drawn = [made_by("rangecal simulate", recording) for recording in drawn]
        return drawn[0] if len(drawn) == 1 else drawn
    if calibration is not None:
        raise _native.InputError("a scene has a sensor of its own; give recordings to simulate a calibration")
    if isinstance(scene, Mapping):
        text = json.dumps({"format": "rangecal-scene/1", **scene}, ensure_ascii=False, default=_take.plain)
        drawn = _native.simulate_scene_text(text, seed, effects)
    else:
        path = _take.path("scene", scene, "a path, a dictionary, a Diagnosis or recordings")
        drawn = _native.simulate_scene_file(path, seed, effects)
    return made_by("rangecal simulate", drawn)


def diagnose(recordings, simulation=None, *, curve="auto", alarm_rate=0.02, force=None, without=(), held_out=True, unseen=True,
             next_experiments=True, laws=False, progress=None):
    """Find what the model leaves out, name the physics, complete the model.

    Parameters
    ----------
    recordings : Recording, path, or list of these
    simulation : Calibration, Recording, path, or list of Recording, optional
        What is held against the recordings; without it the seed model fitted to them.
    curve : {"auto", "polynomial", "reciprocal", "spline"}
        Of the seed model, as in `calibrate`, but ``"auto"`` takes no spline.
    alarm_rate : float
        False alarms per recording of the seed model, all questions together.
    force : list of str, or one, optional
        Fit exactly these effects, whatever the residuals say.
    without : list of str, or one
        Effects to leave out of the catalogue: what would be found without them?
    held_out, unseen, next_experiments : bool
        Parts that can be left out to save time.
    laws : bool
        Look for formulas of what has no name (`Diagnosis.laws`).
    progress : callable, optional
        ``progress(stage, fraction)``, with the fraction done.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        For recordings that no calibration can use.
    """
    calibration, other = None, []
    if isinstance(simulation, (str, os.PathLike)):
        simulation = load(simulation)
    if isinstance(simulation, Calibration):
        calibration = simulation
    elif simulation is not None:
        other = _take.recordings("simulation", simulation)
    recordings = _take.recordings("recordings", recordings)
    diagnosis = _native.diagnose_job(
        recordings, calibration, other, None if curve is None or curve == "auto" else str(curve),
        _take.number("alarm_rate", alarm_rate),
        None if force is None else _take.texts(force), _take.texts(without), _take.flag("held_out", held_out), _take.flag("unseen", unseen),
        _take.flag("next_experiments", next_experiments), _take.flag("laws", laws), _take.progress(progress))
    diagnosis._recordings = recordings
    return diagnosis


def residuals(recordings, calibration, along=()):
    """What a calibration leaves of every reading.

    Parameters
    ----------
    recordings : Recording, path, or list of these
    calibration : Calibration or path
        With its effects, and stops where it has them; else the commanded ones stand in.
    along : list of str, or one
        Covariates wanted beside the residuals: ``range``, ``disparity`` (1 / true distance), ``sensor_bearing``,
        ``heading``, ``time``, ``stop``, ``repeat``, ``landmark``, ``radius``, or a column of the recording.

    Returns
    -------
    Residuals
        One entry per reading, ordered by recording, stop, landmark and time.

    Raises
    ------
    InputError
        For a covariate that is not known, a calibration without a curve or without a place for a landmark that was read.
    """
    recordings, along = _take.recordings("recordings", recordings), _take.texts(along)
    found = _native.residuals_job(recordings, _take.calibration("calibration", calibration), along)
    known = list(dict.fromkeys((*_COVARIATES, *found.along, *(name for r in recordings for name in r.covariates))))
    for name in along:   # one that the recordings lack is left out
        _take.known("along: the covariate", name, known)
    return found


def study(path, *, repeats=None, threads=0, progress=None):
    """Run a Monte-Carlo accuracy study in memory.

    The same numbers, to the last bit, as ``rangecal study``, which also keeps a journal and runs on many machines.

    Parameters
    ----------
    path : str or os.PathLike
        A study file (``docs/study.md``).
    repeats : int, optional
        Of every point, in place of the file's.
    threads : int
        0: all cores.
    progress : callable, optional
        ``progress(point, fraction)``.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        Naming file, row and field of what cannot be used.
    """
    return Study(*_native.study_job(
        _take.path("path", path), None if repeats is None else _take.whole("repeats", repeats, 1),
        _take.whole("threads", threads), _take.progress(progress)))


def effects():
    """The catalogue of physical effects that `diagnose` knows.

    Returns
    -------
    list of Effect
        Ordered by id, those of `load_effects` last; each with its physics, formula, source and parameters.
    """
    return _native.effects()


def load_effects(folder):
    """Make effects of your own known: a formula in a ``.yaml`` file each (docs/effects-by-formula.md).

    From then on `diagnose`, `simulate` and `correct` treat them as those of the catalogue, as long as the program runs.

    Parameters
    ----------
    folder : str or os.PathLike

    Returns
    -------
    list of str
        Their ids.

    Raises
    ------
    InputError
        Naming file, row and field of what cannot be used.
    """
    return _native.load_effects(_take.path("folder", folder))


def compare_curves(before, after):
    """How f changed from one calibration to another.

    Parameters
    ----------
    before, after : Calibration or path

    Returns
    -------
    CurveChange
        Largest and RMS change over the range of `after` [m], and the p-value of no change.
    """
    return _native.compare_curves(_take.calibration("before", before), _take.calibration("after", after))

