# SPDX-License-Identifier: BSD-3-Clause
"""Making a recording from arrays or data frames, and showing it as one."""
import json

import numpy as np

from . import _native

_native_init = _native.Recording.__init__


def init(self, observations=None, stops=None, landmarks=None, *, pairs=None, sensor=None, sigma_xy_m=0.01,
         sigma_heading_rad=0.0, stop_error="independent", radius_m=0.0, known_distances=(), true_stops=None,
         true_landmarks=None, extraction=None):
    """A recording from tables in memory, checked as files are.

    Parameters
    ----------
    observations : dict of array_like (n,), structured array, or pandas.DataFrame
        Columns ``stop, landmark, range_m, bearing_rad``; optional ``repeat, time_s``; every other numeric column is a
        covariate. Angles in radians, NaN where a reading is missing.
    stops : table
        Columns ``stop, x_m, y_m, heading_rad``, the commanded poses; optional ``sigma_xy_m, sigma_heading_rad,
        place``, and the covariance of a stop or step ``cov_xx_m2, cov_xy_m2, cov_yy_m2, cov_hh_rad2, cov_xh_m_rad,
        cov_yh_m_rad``.
    landmarks : table, optional
        Column ``landmark``; optional ``radius_m, reflectance``.
    pairs : table, optional
        Instead of the above, known distances: columns ``true_m, reading_m``; optional ``batch, time_s, landmark,
        bearing_rad`` and covariates.
    sensor : dict, optional
        ``name, principle, range_min_m, range_max_m``.
    sigma_xy_m : float or "estimate"
        How far a stop may be from its commanded place, one standard deviation per axis [m].
    sigma_heading_rad : float
        The same of headings [rad]; 0: exact.
    stop_error : {"independent", "random_walk"}
    radius_m : float
        Of landmarks that `landmarks` gives none [m].
    known_distances : list of dict
        Taped distances: ``{"from": "A", "to": "B", "distance_m": 1.5, "sigma_m": 0.002}``.
    true_stops, true_landmarks : table, optional
        Ground truth, for scores only.
    extraction : dict, optional
        How the readings were cut out of raw scans, kept for people: ``source, arc, ...``, each a text, number or list.

    Raises
    ------
    InputError
        Naming table, row and column; rows count as in a file, the header being row 1.
    """
    header = {"format": "rangecal/1", "sensor": sensor or {}}
    if pairs is not None:
        if observations is not None or stops is not None:
            raise _native.InputError("a recording has either pairs, or observations and stops")
        header["kind"] = "pairs"
        tables = {"pairs.csv": pairs, "landmarks.csv": landmarks}
    else:
        if observations is None or stops is None:
            raise _native.InputError("a recording needs observations and stops, or pairs")
        header["kind"] = "landmarks"
        header["stops"] = {"sigma_xy_m": sigma_xy_m, "sigma_heading_rad": sigma_heading_rad, "error": stop_error}
        tables = {"observations.csv": observations, "stops.csv": stops, "landmarks.csv": landmarks,
                  "truth_stops.csv": true_stops, "truth_landmarks.csv": true_landmarks}
    header["landmarks"] = {"radius_m": radius_m}
    if extraction:
        header["extraction"] = dict(extraction)
    if known_distances:
        header["known_distances"] = list(known_distances)
    _native_init(self, json.dumps(header, ensure_ascii=False, default=float),
                 {name: _columns(table) for name, table in tables.items() if table is not None})


def _columns(table):
    if hasattr(table, "columns") and hasattr(table, "loc"):
        return {str(name): _series(table[name]) for name in table.columns}
    if isinstance(table, np.ndarray) and table.dtype.names:
        return {name: table[name] for name in table.dtype.names}
    return {str(name): np.asarray(column) for name, column in dict(table).items()}


def _series(series):
    if series.dtype.kind in "iufb":
        return series.to_numpy(dtype=float, na_value=np.nan)
    return series.astype(object).where(series.notna(), None).to_numpy()


def columns(self):
    """The readings by column, labels instead of indices.

    Returns
    -------
    dict of ndarray (n,)
        Columns that the recording lacks are left out; numbers are views on the recording.
    """
    if self.kind == "pairs":
        names = ("true_m", "time_s", "bearing_rad")
        table = {"reading_m": self.range_m}
        if self.batch is not None:
            table["batch"] = np.array(self.batch_labels + [None], dtype=object)[self.batch]
    else:
        names = ("repeat", "time_s", "range_m", "bearing_rad")
        table = {"stop": np.array(self.stop_labels, dtype=object)[self.stop]}
    if self.landmark is not None:
        table["landmark"] = np.array(self.landmark_labels, dtype=object)[self.landmark]
    table.update({name: getattr(self, name) for name in names if getattr(self, name) is not None})
    table.update(self.covariates)
    return table


def to_frame(self):
    """The readings as a pandas.DataFrame, one row per reading, columns as in the file."""
    import pandas
    return pandas.DataFrame(self.columns(), copy=True)


def stops_to_frame(self):
    """The commanded stops as a pandas.DataFrame: ``stop, x_m, y_m, heading_rad``."""
    import pandas
    frame = pandas.DataFrame(np.array(self.stops), columns=["x_m", "y_m", "heading_rad"])
    frame.insert(0, "stop", self.stop_labels)
    return frame


def describe(self):
    """The recording in one line."""
    name = self.path or self.sensor.name or "in memory"
    if self.kind == "pairs":
        return f"{name}: {len(self)} pairs"
    return f"{name}: {len(self.stop_labels)} stops, {len(self.landmark_labels)} landmarks, {len(self)} readings"
