# SPDX-License-Identifier: BSD-3-Clause
"""A bag to try things on, where no recorded one is at hand: write(PATH, SEED) simulates it."""
import struct

import numpy as np

RADIUS = 0.10                                                   # of the pipes [m]
PIPES = np.array([[1.5, 0.9], [2.1, -0.8], [0.3, -1.2], [2.6, 0.6], [-0.5, 0.8], [0.7, 1.4], [-0.6, -0.7]])
STOPS = [(0.15 * k, 0.09 * np.sin(0.8 * k), 0.5 * np.sin(0.5 * k)) for k in range(12)]   # x, y [m], heading [rad]
BEAMS, SCANS = 1440, 12                                         # of a turn; at each stop
ODOMETRY = 0.005                                                # how far off the robot is where it stands [m]
WARM_UP, AFTER = -0.015, 25.0                                   # what the calibration is not told: [m] at first, less by e after [s]


def curve(d):
    """What the sensor, warm, says of a distance, without noise [m]."""
    return 0.03 + 0.92 * d + 0.03 * d**2


def scan_at(x, y, heading, seconds, rng):
    """Bearing of the first beam [rad] and ranges of a turn [m], infinite where no pipe is hit. The beams of no two scans agree."""
    first = -np.pi + 2 * np.pi / BEAMS * rng.random()
    bearings = first + 2 * np.pi / BEAMS * np.arange(BEAMS)
    directions = np.stack([np.cos(bearings + heading), np.sin(bearings + heading)], axis=1)
    nearest = np.full(BEAMS, np.inf)
    for pipe in PIPES:
        along = directions @ (pipe - (x, y))                    # to the foot of the perpendicular from the axis
        aside = directions @ np.array([[0, 1], [-1, 0]]) @ (pipe - (x, y))
        hit = (along > 0) & (np.abs(aside) < RADIUS)
        nearest[hit] = np.minimum(nearest[hit], along[hit] - np.sqrt(RADIUS**2 - aside[hit]**2))
    seen = np.isfinite(nearest)
    f = curve(nearest[seen])
    nearest[seen] = f + WARM_UP * np.exp(-seconds / AFTER) + 0.002 * f**2 * rng.standard_normal(f.size)
    return first, nearest


def cdr(*parts):
    """ROS 2's encoding, little-endian: every part a format of `struct` and its values, aligned to its size."""
    out = b""
    for form, *values in parts:
        size = struct.calcsize("<" + form[-1]) if form[-1] != "s" else 1
        out += b"\0" * (-len(out) % size) + struct.pack("<" + form, *values)
    return b"\0\1\0\0" + out


def header(stamp, frame):
    name = frame.encode() + b"\0"
    return (("i", int(stamp)), ("I", round(1e9 * (stamp % 1.0))), ("I", len(name)), (f"{len(name)}s", name))


def laser_scan(stamp, first, step, ranges):
    return cdr(*header(stamp, "laser"), ("f", first), ("f", first + step * (len(ranges) - 1)), ("f", step), ("f", 0.0), ("f", 0.1),
               ("f", 0.05), ("f", 30.0), ("I", len(ranges)), (f"{len(ranges)}f", *ranges), ("I", 0))


def odometry(stamp, x, y, heading):
    return cdr(*header(stamp, "odom"), ("I", 10), ("10s", b"base_link\0"),
               ("7d", x, y, 0.0, 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)), ("78d", *[0.0] * 78))


def mcap(topics, messages):
    """An MCAP file of ROS 2 without chunks and index: topics by name, each its type; messages (topic, stamp [s], bytes)."""
    def text(words):
        return struct.pack("<I", len(words)) + words.encode()

    def record(opcode, content):
        return struct.pack("<BQ", opcode, len(content)) + content

    magic = b"\x89MCAP0\r\n"
    out = magic + record(1, text("ros2") + text("rangecal, stand_in_bag.py"))
    for number, (topic, kind) in enumerate(topics.items(), 1):
        out += record(3, struct.pack("<H", number) + text(kind) + text("ros2msg") + text(""))
        out += record(4, struct.pack("<HH", number, number) + text(topic) + text("cdr") + text(""))
    for sequence, (topic, stamp, message) in enumerate(messages):
        time = int(1e9 * stamp)
        out += record(5, struct.pack("<HIQQ", 1 + list(topics).index(topic), sequence, time, time) + message)
    return out + record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + magic


def write(path, seed=1):
    """A robot drives, stands at twelve places and scans seven pipes: /scan and /odom, an MCAP file of ROS 2."""
    rng = np.random.default_rng(seed)
    stamp, messages = 100.0, []
    for x, y, heading in STOPS:
        there = (x + ODOMETRY * rng.standard_normal(), y + ODOMETRY * rng.standard_normal(), heading)
        for _ in range(SCANS):
            first, ranges = scan_at(*there, stamp - 100.0, rng)
            messages.append(("/odom", stamp, odometry(stamp, x, y, heading)))
            messages.append(("/scan", stamp, laser_scan(stamp, first, 2 * np.pi / BEAMS, ranges)))
            stamp += 0.2
        stamp += 3.0
    path.write_bytes(mcap({"/scan": "sensor_msgs/msg/LaserScan", "/odom": "nav_msgs/msg/Odometry"}, messages))
