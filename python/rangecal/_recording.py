# SPDX-License-Identifier: BSD-3-Clause
"""Making a recording from arrays or data frames, and showing it as one."""
import json
from collections.abc import Mapping

import numpy as np

from . import _native, _take

_native_init, _native_save = _native.Recording.__init__, _native.Recording.save


def init(self, observations=None, stops=None, landmarks=None, *, pairs=None, sensor=None, sigma_xy_m=0.01,
         sigma_heading_rad=0.0, stop_error="independent", radius_m=0.0, known_distances=(), true_stops=None,
         true_landmarks=None, columns=None, group_by=(), reference=None, extraction=None):
    """A recording from tables in memory, checked as files are.

    Parameters
    ----------
    observations : dict of array_like (n,), structured array, or pandas.DataFrame
        Columns ``stop, landmark, range_m, bearing_rad``; optional ``repeat, time_s``; every other numeric column is a
        covariate; without ``bearing_rad``, ranges alone. Angles in radians, NaN where a reading is missing.
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
    columns : dict, optional
        What covariates measure whose names do not say it: ``{"T1": {"role": "temperature", "unit": "degC"}}``; roles
        ``received_power, temperature, azimuth, elevation, supply_voltage, intensity, other``.
    group_by : str or list of str
        Columns, of numbers or texts, that say which readings belong together (trials, days, places): `diagnose` holds
        out whole groups.
    reference : dict, optional
        How well `true_m` is known: ``sigma_m`` of a stated distance [m], and ``time_offset_s``: a reading at time t
        belongs to the true distance at t + time_offset_s.
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
        if true_stops is not None or true_landmarks is not None:
            raise _native.InputError("the truth of pairs is their column true_m: they take no true_stops, nor true_landmarks")
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
    if columns:
        header["columns"] = columns
    if group_by:
        header["group_by"] = names_of_columns(group_by)
    if reference:
        header["reference"] = reference
    if extraction:
        header["extraction"] = extraction
    if known_distances:
        header["known_distances"] = known_distances
    _native_init(self, json.dumps(header, ensure_ascii=False, default=_take.plain),
                 {name: columns_of(name, table) for name, table in tables.items() if table is not None})


def names_of_columns(group_by):
    """One column's name, or several, as a list."""
    return [group_by] if isinstance(group_by, str) else list(group_by)


def save(self, folder, *, overwrite=False):
    """Write it as a folder that `load` and the command line read.

    Parameters
    ----------
    folder : str or os.PathLike
        Made if missing. A recording that is in it already is replaced where a program made it: simulated, extracted or
        imported.
    overwrite : bool
        Replace a measured one too.

    Raises
    ------
    InputError
        Where the folder holds a recording that no program made, or cannot be written.
    """
    _native_save(self, _take.path("folder", folder), self._maker, _take.flag("overwrite", overwrite))


def made_by(maker, recording):
    """The recording, which says from now on that a program made it, so that what is saved of it may be replaced."""
    recording._maker = maker
    return recording


def is_table(value):
    return isinstance(value, Mapping) or _is_frame(value) or bool(getattr(getattr(value, "dtype", None), "names", None))


def _is_frame(value):
    return hasattr(value, "columns") and hasattr(value, "loc")


def columns_of(name, table):
    """The columns of a table by name. `name` is the table's, for errors."""
    if not is_table(table):
        raise TypeError(f"{name}: {_take.shown(table)} is no table: a dictionary of columns, a structured array or a "
                        "pandas.DataFrame")
    if not _is_frame(table):
        names = table if isinstance(table, Mapping) else table.dtype.names
        return {str(column): _take.unmasked(table[column]) for column in names}
    if not table.columns.is_unique:
        raise _native.InputError(f"{name}: several columns have one name")
    return {str(column): _series(table[column]) for column in table.columns}


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
    for i, name in enumerate(self.group_by):
        if name not in table:
            table[name] = np.array([labels[i] for labels in self.group_labels], dtype=object)[self.group]
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
