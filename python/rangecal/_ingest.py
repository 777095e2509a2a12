# SPDX-License-Identifier: BSD-3-Clause
"""Raw scans and published data sets: arguments of Python as the words of the command line, which checks them."""
import json
import math
import os
import tempfile

import numpy as np

from . import _native, _take
from ._recording import columns_of, made_by
from ._results import CorrectedBag, Extraction


def extract(scans, stops=None, *, radius_m=None, landmarks=None, arc="nearest", beams_min=4, edge_cut=0.9, support=0.5,
            split="automatic", scans_min=None, sigma_xy_m=None, sigma_heading_rad=None, stop_error="independent",
            noise=None, range_min_m=0.0, range_max_m=math.inf, clockwise=False, bearing_offset_rad=0.0, name="",
            principle="", topic="", odometry_topic="", frames=""):
    """Find cylinders in raw scans and make a recording of them (``docs/extract.md``).

    Parameters
    ----------
    scans : path, list of paths, or table
        Files of scans: CSV, CARMEN logs, bags of ROS 2 (MCAP, SQLite, rosbag2 folders) and, where the build reads them,
        of ROS 1 (``docs/bags.md``). Or one table with a row per beam: columns ``stamp`` [s], ``angle_rad``, ``range_m``,
        optionally ``stop``.
    stops : path or table, optional
        Columns ``stop, x_m, y_m, heading_rad``; else the log's odometry, or one stop at the origin.
    radius_m : float or list of float, optional
        Of the cylinders, one or several kinds [m]; estimated where it is not given, 2 to 20 cm.
    landmarks : path or table, optional
        Known places, for the labels: columns ``landmark, x_m, y_m``, optionally ``radius_m``.
    arc : {"nearest", "mean", "smallest"}
        Which point of the arc is the range.
    beams_min : int
        Hits that a cylinder must have.
    edge_cut : float
        Hits that pass the axis at more than this share of the radius are dropped.
    support : float
        Share of a stop's scans in which a landmark must be found.
    split : {"automatic", "label", "file", "scan", "standing"}
        What tells stops apart.
    scans_min : int, optional
        Scans that a stand must have.
    sigma_xy_m, sigma_heading_rad : float, optional
        How far a stop may be from its pose [m], [rad].
    stop_error : {"independent", "random_walk"}
    noise : (float, float), optional
        Standard deviation of a beam: floor [m] and quadratic part [1/m]; estimated where it is not given.
    range_min_m, range_max_m : float
        Readings outside are no hits [m].
    clockwise : bool
        Bearings of the scans run clockwise.
    bearing_offset_rad : float
        Mount of the sensor, for the labels alone [rad].
    name, principle : str
        Of the sensor, for the recording.
    topic : str
        Of the scans in a bag with several.
    odometry_topic : str
        Of a bag: poses of the stops, and where the robot stands.
    frames : str
        ``"PARENT,CHILD"``: the transform that is the odometry, where that topic holds several.

    Returns
    -------
    Extraction
        Its ``recording``, and what was thrown away and why.

    Raises
    ------
    InputError
        With the message of the command line.

    Warns
    -----
    UserWarning
        A log or a bag was cut off or is damaged, and what could not be read is left out.
    """
    words = _words(radius=_listed("radius_m", radius_m), arc=arc, beams_min=beams_min, edge_cut=edge_cut,
                   support=support, split=split, scans_min=scans_min, sigma_xy=sigma_xy_m,
                   sigma_heading=sigma_heading_rad, error=stop_error, noise=_listed("noise", noise),
                   range_min=range_min_m, range_max=None if range_max_m == math.inf else range_max_m,
                   bearing_offset=bearing_offset_rad,
                   sensor=name or None, principle=principle or None, topic=topic or None,
                   odom=odometry_topic or None, frames=frames or None)
    if _take.flag("clockwise", clockwise):
        words.append("--clockwise")
    with tempfile.TemporaryDirectory() as folder:
        for option, name, table in (("--stops", "stops", stops), ("--map", "landmarks", landmarks)):
            if table is not None:
                words.append(f"{option}={_file(name, table, folder)}")
        paths = scans if isinstance(scans, (list, tuple)) else [scans]
        files = [_file(f"scans{i or ''}", one, folder) for i, one in enumerate(paths)]
        recording, facts, text = _native.extract_job([*words, "--", *files])
    return Extraction(made_by("rangecal extract", recording), json.loads(facts), text)


def correct_bag(calibration, bag, out, *, topic="", keep_raw="", clockwise=False, progress=None):
    """Copy a bag with the readings of one topic turned into distances (``docs/bags.md``).

    Every reading becomes the most likely distance behind it, NaN where none explains it; effects of the calibration are
    undone. All other messages are copied as they are.

    Parameters
    ----------
    calibration : Calibration or path
    bag : path
        MCAP, SQLite or rosbag2 folder; of ROS 1 where the build reads them.
    out : path
        The copy, of the container of `bag`; it is there whole or not at all.
    topic : str
        Of ``sensor_msgs/LaserScan`` or ``sensor_msgs/Range``; may be left out where the bag has one.
    keep_raw : str
        Topic for the messages as they were; empty: they are not kept.
    clockwise : bool
        Bearings of the scans run clockwise: as where `extract` was told so.
    progress : callable, optional
        ``progress(stage, fraction)``; what it raises ends the work.

    Returns
    -------
    CorrectedBag
        How many readings became what.

    Raises
    ------
    InputError
        Where an effect needs what a scan does not hold, the topic is not clear, nothing can be used, or `out` cannot be
        written.

    Warns
    -----
    UserWarning
        The bag was cut off or is damaged, and what could not be read is left out.
    """
    name = _take.path("calibration", calibration) if isinstance(calibration, (str, os.PathLike)) else "calibration"
    return CorrectedBag(**_native.correct_bag(
        _take.calibration("calibration", calibration), name, _take.path("bag", bag), _take.path("out", out), str(topic),
        str(keep_raw), _take.flag("clockwise", clockwise), _take.progress(progress)))


def import_lego(path, *, poses="odometry", track_m=0.150, radius_m=None, arc="nearest"):
    """The LEGO robot among six cylinders (C. Brenner, SLAM Lectures, 2012), as published.

    Parameters
    ----------
    path : str or os.PathLike
        Folder with ``robot4_scan.txt``, ``robot4_motors.txt``, ...
    poses : {"odometry", "reference"}
        Wheel ticks; or places of the overhead camera with headings of the odometry.
    track_m : float
        Distance of the tracks [m].
    radius_m : float, optional
        Written into the recording [m]; else the surveyed one. 0 counts distances to the axis.
    arc : {"nearest", "mean", "smallest"}

    Returns
    -------
    Recording
    """
    return import_dataset("lego", path, poses=poses, track=track_m, radius=radius_m, arc=arc)


def import_mrclam(path, robot, *, kind="stops", poses="mocap", readings_min=4, tubes_min=2, stops_max=0):
    """A robot of the UTIAS multi-robot data set (Leung et al., IJRR 30(8), 2011), as published.

    Parameters
    ----------
    path : str or os.PathLike
        Folder with ``Barcodes.dat``, ``RobotN_Measurement.dat``, ...
    robot : int
        1 to 5.
    kind : {"stops", "pairs"}
        Sightings grouped where the robot stands, tubes unknown; or true distance and reading.
    poses : {"mocap", "odometry"}
        Of the stops.
    readings_min, tubes_min : int
        That a stop must have, must see.
    stops_max : int
        At most so many stops; 0: all.

    Returns
    -------
    Recording
    """
    return import_dataset("mrclam", path, robot=robot, **{"as": kind}, poses=poses, readings_min=readings_min,
                          tubes_min=tubes_min, stops_max=stops_max)


def import_dataset(name, path, **options):
    """Any data set that ``rangecal import`` knows, by its name.

    Parameters
    ----------
    name : str
        ``"lego"``, ``"mrclam"``, ...; ``"csv"``: any table with a column of true distances and one of readings.
    path : str or os.PathLike
        Folder of the data as published, or the table.
    **options
        Those of ``rangecal import NAME --help``, ``_`` in place of ``-``; None: not given; a list: given again for each.

    Returns
    -------
    Recording
        Nothing is corrected: outliers and everything that a calibration has to find stay in.

    Raises
    ------
    InputError
        With the message of the command line.
    """
    words = [*_words(**options), "--", _take.path("path", path)]
    return made_by("rangecal import", _native.import_job(str(name), words)[0])


def _listed(name, values):
    return None if values is None else ",".join(map(repr, np.ravel(_take.numbers(name, values)).tolist()))


def _words(**options):
    return [f"--{name.replace('_', '-')}={one}" for name, value in options.items() if value is not None
            for one in (value if isinstance(value, (list, tuple)) else [value])]


def _file(name, table, folder):
    if isinstance(table, (str, os.PathLike)):
        return _take.path(name, table)
    path = os.path.join(folder, name + ".csv")
    with open(path, "w", encoding="utf-8") as file:
        file.write(_native.csv_text(columns_of(name, table), name))
    return path
