# SPDX-License-Identifier: BSD-3-Clause
"""Results as tables: what the C++ classes show of themselves as data frames, and the corrected readings."""
import dataclasses
import html

import numpy as np

from . import _native, _take
from ._recording import made_by

_f, _f_std, _noise = _native.Calibration.f, _native.Calibration.f_std, _native.Calibration.noise
_save_calibration, _save_diagnosis = _native.Calibration.save, _native.Diagnosis.save
_simulate_all = _native.Diagnosis.simulate_all


class Corrected:
    """Distances behind raw readings.

    Attributes
    ----------
    reading_m : ndarray (n,)
        Raw readings [m].
    distance_m, std_m : ndarray (n,)
        The most likely distance to the surface and its standard deviation [m]; NaN where there is none.
    flag : ndarray of str (n,)
        ``ok``; ``ambiguous`` or ``out_of_range``, ``extrapolated``, ``turning_point``, ``extrapolated_column``, joined
        by ``+`` where several hold. Without a distance: ``out_of_range`` (the nearest is more than 4 standard deviations off), ``missing``,
        ``zero``, ``negative``, ``not_finite``.
    """

    def __init__(self, reading_m, candidates):
        self.reading_m = reading_m
        self._candidates = candidates
        first = candidates["candidate"] <= 1
        self.distance_m = candidates["distance_m"][first]
        self.std_m = candidates["std_m"][first]
        self.flag = np.array(candidates["flag"], dtype=object)[first]

    def __len__(self):
        return len(self.reading_m)

    def __repr__(self):
        good = int(np.sum(self.flag == "ok"))
        return f"<rangecal.Corrected: {len(self)} readings, {good} ok>"

    def _repr_html_(self):
        from . import _html
        return _html.corrected(self)

    def to_frame(self):
        """Every distance that explains a reading, most likely first: ``reading, reading_m, distance_m, std_m,
        candidate, flag``; ``reading`` is the index of the reading."""
        import pandas
        frame = pandas.DataFrame(self._candidates)
        frame.insert(1, "reading_m", self.reading_m[self._candidates["reading"]])
        return frame

    def plot(self, ax=None):
        """Corrected minus raw over the raw reading, with one standard deviation."""
        from . import _plots
        return _plots.corrected(self, ax)


@dataclasses.dataclass(frozen=True)
class CorrectedBag:
    """What became of the readings of a bag.

    Attributes
    ----------
    topic, type : str
        Whose readings were corrected, and of which message.
    format : str
        The container in words, and whether checksums stand behind its messages.
    messages, left_out : int
        Messages of the topic, and those of them that could not be decoded.
    readings, corrected : int
        All of them, and those that have a distance in their place.
    kept : int
        Are no readings (not finite, not positive, outside the message's limits), and what they were.
    without_distance : int
        No distance explains them: NaN in their place.
    ambiguous, out_of_range, extrapolated, extrapolated_column : int
        Have that flag of `correct`; of ``out_of_range`` also those without a distance.
    """

    topic: str
    type: str
    format: str
    messages: int
    left_out: int
    readings: int
    corrected: int
    kept: int
    without_distance: int
    ambiguous: int
    out_of_range: int
    extrapolated: int
    extrapolated_column: int

    def __repr__(self):
        return (f"<rangecal.CorrectedBag: {self.topic}, {self.readings} readings, {self.corrected} corrected, {self.kept} kept, "
                f"{self.without_distance} without a distance>")


class Comparison:
    """Calibrations by several methods, side by side.

    Attributes
    ----------
    calibrations : list of Calibration
        One per method, in the order asked for; ``comparison["marginal"]`` picks one.
    scores : list of TruthScore
        One per calibration, against ground truth where the recordings have any.
    models : list of ModelScore
        Orders and noise laws tried; empty where nothing was to choose.
    notes : list of str
        What was done to the input.
    check : CheckReport or None
        What the second program said about the optimum of the full likelihood.
    """

    def __init__(self, job, recordings):
        self._job, self._recordings = job, recordings
        self.calibrations, self.scores = job.calibrations, job.scores
        self.models, self.notes, self.check = job.models, job.notes, job.check
        for index, calibration in enumerate(self.calibrations):
            calibration.models, calibration.notes, calibration.check = self.models, self.notes, self.check
            calibration._origin = (job, index, recordings)

    def __getitem__(self, method):
        for calibration in self.calibrations:
            if calibration.method == method:
                return calibration
        raise KeyError(method)

    def __len__(self):
        return len(self.calibrations)

    def __iter__(self):
        return iter(self.calibrations)

    def __repr__(self):
        return f"<rangecal.Comparison: {', '.join(f'{c.method} {c.outcome}' for c in self.calibrations)}>"

    def _repr_html_(self):
        from . import _html
        return _html.comparison(self)

    def to_frame(self):
        """One column per method, one row per figure: estimates with their standard deviations, likelihoods, errors
        against ground truth. NaN where a method has none."""
        import pandas
        columns = {}
        for calibration, score in zip(self.calibrations, self.scores):
            column = {"outcome": calibration.outcome}
            for name, row in calibration.to_frame().iterrows():
                column[name], column[f"{name} std"] = row["estimate"], row["std"]
            column.update({
                "joint NLL": calibration.joint_nll, "marginal NLL": calibration.nll, "AIC": calibration.aic,
                "landmark RMSE [m]": score.landmark_rmse_m, "landmark error / std": score.landmark_strain,
                "range RMSE raw [m]": score.rmse_raw_m if score.readings else None,
                "range RMSE corrected [m]": score.rmse_corrected_m if score.readings else None,
                "MSE ratio": score.mse_ratio})
            columns[calibration.method] = column
        order = list(dict.fromkeys(name for column in columns.values() for name in column))
        return pandas.DataFrame(columns).reindex(order)

    def plot(self, ax=None):
        """f(d) - d of every method; the ends of its 95 % band are dotted."""
        from . import _plots
        return _plots.comparison(self, ax)

    def report(self, path):
        """Write the report of ``rangecal compare --report``: one HTML file that needs no network.

        Raises
        ------
        InputError
            Where the file cannot be written, or this build has no charting library.
        """
        _native.report_comparison(self._job, self._recordings, _take.path("path", path))


class Study:
    """Tables of a Monte-Carlo study, one row per point of its grid and estimator (``docs/study.md`` has the columns).

    Attributes
    ----------
    name : str
        Of the study.
    results_csv, timing_csv : str
        The tables as files hold them. Times are apart, since no two runs agree in them.
    """

    def __init__(self, name, results_csv, timing_csv):
        self.name, self.results_csv, self.timing_csv = name, results_csv, timing_csv

    def __len__(self):
        return self.results_csv.count("\n") - 1

    def __repr__(self):
        return f"<rangecal.Study: {len(self)} rows>"

    def _repr_html_(self):
        return self.to_frame().to_html(notebook=True)

    def to_frame(self, timing=False):
        """The results, or the processor times, as a pandas.DataFrame."""
        import io
        import pandas
        return pandas.read_csv(io.StringIO(self.timing_csv if timing else self.results_csv),
                               float_precision="round_trip")

    def plot(self, x, y, ax=None):
        """One column over another, a line per estimator (and per value of every other parameter that varies)."""
        from . import _plots
        return _plots.study(self, x, y, ax)

    def report(self, path):
        """Write the report of ``rangecal study --report``: one HTML file that needs no network."""
        _native.report_study(self.name, self.results_csv, _take.path("path", path))


class Extraction:
    """What was found in raw scans, and what was thrown away and why.

    Attributes
    ----------
    recording : Recording or None
        None where no landmark was found.
    counts : dict of dict of int
        Of ``scans``, ``beams``, ``segments`` and ``cylinders``: how many of them ended how.
    noise : dict
        ``floor_m, quadratic_per_m, origin``: standard deviation of a beam at r,
        ``sqrt(floor_m**2 + (quadratic_per_m * r**2)**2)`` [m], and where it is from.
    arc : str
        Which point of the arc is the range.
    runs_clockwise : bool
        With bearings turned round the stops agree much better: try ``clockwise=True``.
    text : str
        All of it as the command line prints it.
    """

    def __init__(self, recording, facts, text):
        self.recording = recording if facts["landmarks"] else None
        self.counts = {part: facts[part] for part in ("scans", "beams", "segments", "cylinders")}
        self.noise, self.arc, self.runs_clockwise = facts["noise"], facts["arc"], facts["runs_clockwise"]
        self.text = text
        self._landmarks = facts["landmarks"]

    def __repr__(self):
        return f"<rangecal.Extraction: {len(self._landmarks)} landmarks, {self.counts['cylinders'].get('used', 0)} readings>"

    def _repr_html_(self):
        return f"<pre>{html.escape(self.text)}</pre>"

    def to_frame(self):
        """The landmarks as a pandas.DataFrame: ``landmark, radius_m, x_m, y_m, stops, readings``."""
        import pandas
        return pandas.DataFrame(self._landmarks, columns=["landmark", "radius_m", "x_m", "y_m", "stops", "readings"])


def f(self, distance_m):
    """Mean reading f(d) [m] at true distances [m] of any shape; NaN without a curve."""
    return _f(self, _take.numbers("distance_m", distance_m))


def f_std(self, distance_m):
    """Standard deviation of f(d) [m], same shape, by ``covariance_with_choice`` where there is one, else ``covariance``, and
    the shape of a spline; NaN without either."""
    return _f_std(self, _take.numbers("distance_m", distance_m))


def noise(self, distance_m):
    """Standard deviation s(d) of one reading [m], same shape."""
    return _noise(self, _take.numbers("distance_m", distance_m))


def save_calibration(self, path):
    """Write the file that `load` and `rangecal correct` read."""
    _save_calibration(self, _take.path("path", path))


def save_diagnosis(self, path):
    """Write it as `rangecal diagnose --json` does."""
    _save_diagnosis(self, _take.path("path", path))


def simulate_all(self, seed):
    """The recordings drawn anew from the final model; the same seed gives the same."""
    return [made_by("rangecal simulate", recording) for recording in _simulate_all(self, _take.seed(seed))]


def report_calibration(self, path):
    """Write the report of ``rangecal calibrate --report``: one HTML file that needs no network.

    Parameters
    ----------
    path : str or os.PathLike

    Raises
    ------
    InputError
        For a calibration that was read from a file: a report shows the recordings too. Where the file cannot be written,
        or this build has no charting library.
    """
    if self._origin is None:
        raise _native.InputError("a report shows the recordings too: it takes a calibration made by calibrate or compare")
    _native.report_calibration(*self._origin, _take.path("path", path))


def report_diagnosis(self, path):
    """Write the report of ``rangecal diagnose --report``: one HTML file that needs no network.

    Parameters
    ----------
    path : str or os.PathLike

    Raises
    ------
    InputError
        Where the file cannot be written, or this build has no charting library.
    """
    _native.report_diagnosis(self, self._recordings, _take.path("path", path))


def mcap_diagnosis(self, path):
    """Write what ``rangecal diagnose --mcap`` does: scans, landmarks, stops, residuals and the finding for viewers
    (``docs/viewers.md``).

    Parameters
    ----------
    path : str or os.PathLike

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    _native.mcap_diagnosis(self, self._recordings, _take.path("path", path))


def models_to_frame(self):
    """Orders and noise laws tried: ``order, noise_law, nll, aic, behind``, best first; `behind` in AIC."""
    import pandas
    frame = pandas.DataFrame([(m.order, m.noise_law, m.nll, m.aic) for m in self.models],
                             columns=["order", "noise_law", "nll", "aic"])
    frame["behind"] = frame["aic"] - frame["aic"].min()
    return frame.sort_values("aic", ignore_index=True)


def calibration_to_frame(self):
    """The parameters with their standard deviations: index ``parameter``, columns ``estimate, std, unit``."""
    import pandas
    rows = []
    covariance = self.covariance
    for i, value in enumerate(self.alpha):
        std = np.sqrt(max(covariance[i, i], 0.0)) if covariance is not None else np.nan
        rows.append((f"alpha_{i}", value, std, _unit(1 - i)))
    noise_std = self.noise_std if len(self.noise_std) == len(self.noise_parameters) else \
        np.full(len(self.noise_parameters), np.nan)
    power = {"constant": 0, "f": 1, "f2": 2, "f3": 3, "d2": 2}.get(self.noise_law)
    for i, (value, std) in enumerate(zip(self.noise_parameters, noise_std)):
        name = f"beta_{i}" if power is None else "sigma_e"
        rows.append((name, value, std, _unit(1 - (i if power is None else power))))
    for name, value, std, unit in (("sigma_theta", self.sigma_theta_rad, self.sigma_theta_std_rad, "rad"),
                                   ("sigma_s", self.sigma_s_m, self.sigma_s_std_m, "m")):
        if value is not None:
            rows.append((name, value, np.nan if std is None else std, unit))
    for effect, parameters in self.effects.items():
        rows.extend((f"{effect}.{name}", value, np.nan, "") for name, value in parameters.items())
    frame = pandas.DataFrame(rows, columns=["parameter", "estimate", "std", "unit"])
    return frame.set_index("parameter")


def landmarks_to_frame(self):
    """The landmarks placed: ``recording, landmark, x_m, y_m, std_x_m, std_y_m, correlation``."""
    import pandas
    covariance = self.landmark_covariance
    std = np.sqrt(np.einsum("nii->ni", covariance)) if len(covariance) else np.empty((0, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance[:, 0, 1] / (std[:, 0] * std[:, 1]) if len(covariance) else np.empty(0)
    return pandas.DataFrame({
        "recording": self.landmark_recording, "landmark": self.landmark_labels, "x_m": self.landmarks[:, 0],
        "y_m": self.landmarks[:, 1], "std_x_m": std[:, 0], "std_y_m": std[:, 1], "correlation": correlation})


def stops_to_frame(self):
    """The stops estimated: ``recording, stop, x_m, y_m, heading_rad``."""
    import pandas
    return pandas.DataFrame({
        "recording": self.stop_recording, "stop": self.stop_labels, "x_m": self.stops[:, 0],
        "y_m": self.stops[:, 1], "heading_rad": self.stops[:, 2]})


def diagnosis_to_frame(self, table="explanations"):
    """One part of the diagnosis as a table.

    Parameters
    ----------
    table : {"explanations", "location", "fit", "unseen", "next_experiments", "readings"}
        ``"readings"``: a row for every reading of the recordings, with all their columns, the true distance and the
        corrected reading by the final model, and residuals with their standard deviations before and after: of the seed
        model and of the final one.
    """
    import pandas
    if table == "explanations":
        rows = [(" + ".join(e.effects), e.probability, p.name, p.estimate, p.std, *p.ci95)
                for e in self.explanations for p in (e.parameters or [None]) if p is not None]
        return pandas.DataFrame(rows, columns=["effects", "probability", "parameter", "estimate", "std", "low95",
                                               "high95"])
    if table == "location":
        rows = [(f.channel, f.covariate, f.shape, *f.where, f.group, f.size, f.unit, f.p_value, f.share,
                 " + ".join(f.effects))
                for f in self.location]
        return pandas.DataFrame(rows, columns=["channel", "covariate", "shape", "from", "to", "group", "size", "unit",
                                               "p_value", "share", "effects"])
    if table == "fit":
        names = ("nll", "heldout_nll", "heldout_std", "heldout_rms_range_m", "rms_range_m", "rms_bearing_rad", "chi_sq_per_dof")
        return pandas.DataFrame({"before": [getattr(self.before, n) for n in names],
                                 "after": [getattr(self.after, n) for n in names]}, index=names)
    if table == "unseen":
        rows = [(u.effect, u.detectable, u.harm_m, u.settled_by) for u in self.unseen]
        return pandas.DataFrame(rows, columns=["effect", "detectable", "harm_m", "settled_by"])
    if table == "next_experiments":
        rows = [(e.change, ", ".join(e.settles), e.power) for e in self.next_experiments]
        return pandas.DataFrame(rows, columns=["change", "settles", "power"])
    if table == "readings":
        return _every_reading(self)
    raise ValueError(f"table is '{table}', not explanations, location, fit, unseen, next_experiments or readings")


def _every_reading(self):
    """Columns of the recordings, joined with the residuals of both models."""
    import pandas
    before, after = _native.residuals_of_diagnosis(self, self._recordings)
    frames = []
    for number, recording in enumerate(self._recordings):
        mine = np.flatnonzero(after.recording == number)
        mine = mine[np.argsort(after.reading[mine])]   # in the order of the recording's own columns
        frame = recording.to_frame()
        frame.insert(0, "recording", number)
        frame.insert(1, "row", after.row[mine])
        frame["distance_m"], frame["corrected_m"] = after.distance_m[mine], after.corrected_m[mine]
        for when, model in (("before", before), ("after", after)):
            for channel in ("range", "bearing") if recording.kind == "landmarks" else ("range",):
                unit = "m" if channel == "range" else "rad"
                frame[f"{channel}_residual_{when}_{unit}"] = getattr(model, f"{channel}_residual_{unit}")[mine]
                frame[f"{channel}_std_{when}_{unit}"] = getattr(model, f"{channel}_std_{unit}")[mine]
        frames.append(frame)
    return pandas.concat(frames, ignore_index=True)


def residuals_to_frame(self):
    """One row per reading: indices, reading, distance, residuals with their standard deviations, covariates."""
    import pandas
    names = ("recording", "reading", "stop", "landmark", "repeat", "row", "reading_m", "bearing_rad", "distance_m",
             "range_residual_m", "range_std_m", "bearing_residual_rad", "bearing_std_rad", "corrected_m")
    columns = {name: np.array(getattr(self, name)) for name in names}
    columns.update({name: np.array(values) for name, values in self.along.items()})
    return pandas.DataFrame(columns)


def _unit(power):
    return {0: "", 1: "m"}.get(power, f"1/m^{-power}" if power < -1 else "1/m")
