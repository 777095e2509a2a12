#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A second, independent simulator of a cheap triangulating range sensor on a small wheeled robot.

A robot stops at K places of a room and takes ranges and bearings to L cylinders, R times each. Everything is drawn from
(seed, world). Causes of error are built into the hardware: image position of the spot in pixels, baseline, turntable,
encoder, wheels, clock, targets. Nothing here was taken from rangecal's own simulator or catalogue.

Writes FOLDER/recording (what rangecal reads) and FOLDER/truth.json (what was planted).
"""
import argparse
import json
import os
import sys

import numpy as np

SWEEP_S = 0.2      # one turn of the sensor
TRACK_M = 0.25     # distance between the robot's wheels

# id: (ids of `rangecal effects` which say the same physics, unit, largest sensible size, kind)
# kind: mean = scaled to a wanted noncentrality; noise = a fixed plausible size; outside = no name says it (scaled too).
CAUSES = {
    # turntable and encoder
    "encoder_off_centre": (["encoder_eccentricity"], "rad", 0.06, "mean"),           # 1.5 mm off at a 25 mm ring
    "encoder_on_bent_joint": (["encoder_ellipticity"], "rad of bend", 0.4, "mean"),
    "turntable_gear_ratio": (["bearing_scale"], "1", 0.03, "mean"),
    "yaw_of_mount": (["bearing_offset"], "rad", 0.10, "mean"),
    "encoder_zero_creeps": (["bearing_drift", "heading_drift"], "rad in all", 0.10, "mean"),
    "mount_swings_out": (["settling"], "rad", 0.10, "mean"),
    "scan_plane_tilted": (["tilt"], "rad", 0.26, "mean"),
    "beam_beside_axis": (["beam_offset"], "m", 0.04, "mean"),
    "sensor_beside_turning_point": (["lever_arm"], "m", 0.15, "mean"),
    "cone_mirror_off_axis": (["range_eccentricity"], "m", 0.04, "mean"),
    # optics and electronics
    "lens_barrel": (["lens_distortion"], "share of u at the edge", 0.03, "mean"),
    "peak_pulled_to_pixel": (["pixel_locking"], "px", 0.25, "mean"),
    "near_exposure": (["near_regime"], "px", 1.5, "mean"),
    "phase_crosstalk": (["cyclic_error"], "1", 0.15, "mean"),
    "warm_up_of_delay": (["warmup_drift"], "m", 0.06, "mean"),
    "warm_up_of_pointing": (["warmup_drift"], "px", 2.0, "mean"),
    "baseline_expands": (["temperature_coefficient", "range_scale"], "1/K", 5e-4, "mean"),
    "delay_with_temperature": (["temperature_coefficient", "covariate_drift"], "m/K", 3e-3, "mean"),
    "pointing_with_temperature": (["temperature_coefficient", "covariate_drift"], "px/K", 0.1, "mean"),
    "lamp_in_sector": (["ambient_light"], "px", 1.0, "mean"),
    # targets
    "cylinder_carried_away": (["moved_landmark"], "m", 0.30, "mean"),
    "one_radius_wrong": (["landmark_radius"], "m", 0.06, "mean"),
    "radii_wrong": (["radius_scale"], "1", 0.6, "mean"),
    "mean_of_the_arc": (["arc_definition"], "share of the width used", 0.98, "mean"),
    "oval_cylinder": (["landmark_shape"], "1", 0.4, "mean"),
    "glossy_cylinder": (["target_reflectance"], "px", 1.0, "mean"),
    "translucent_cylinder": (["target_reflectance"], "m", 0.04, "mean"),
    # robot
    "wheel_radius": (["odometry_scale"], "1", 0.05, "mean"),
    "track_width": (["turn_scale"], "1", 0.08, "mean"),
    "unequal_wheels": (["path_curvature"], "1", 0.02, "mean"),
    "gyro_drifts": (["heading_drift"], "rad in all", 0.30, "mean"),
    "wheels_slip_once": (["wheel_slip"], "m", 0.30, "mean"),
    # noise, tails, labels, grids
    "clutter_behind": (["late_return"], "share", 0.03, "noise"),
    "dust": (["early_echo"], "share", 0.03, "noise"),
    "other_lidar": (["heavy_tails"], "share", 0.03, "noise"),
    "edges_cut_the_spot": (["mixed_pixels", "late_return"], "share", 0.04, "noise"),
    "labels_exchanged": (["label_swap"], "stops", 3, "noise"),
    "centroid_rounded": (["quantisation"], "px", None, "noise"),
    "output_rounded": (["quantisation"], "m", None, "noise"),
    "beam_grid": (["bearing_quantisation"], "rad", None, "noise"),
    "speckle": (["cell_effect"], "of the noise", None, "noise"),
    "filter_per_beam": (["autocorrelated_noise"], "correlation", None, "noise"),
    "pointing_wanders": (["autocorrelated_noise"], "correlation", None, "noise"),
    "dark_cylinder": (["dark_target"], "factor", None, "noise"),
    "noise_floor": (["noise_law"], "of the noise at the median", None, "noise"),
    "sigma_of_stops_guessed": (["stated_sigma", "stop_effect"], "factor", None, "noise"),
    "slip_adds_up": (["odometry_random_walk"], "factor", None, "noise"),
    "weak_spot": (["reciprocal_noise"], "s / d of far readings", 0.12, "noise"),
    # what no name says
    "turntable_backlash": ([], "rad", 0.05, "outside"),      # sweeps go to and fro; the encoder lags behind either way
    "multipath_bump": ([], "m", 0.30, "outside"),            # a bump of the curve near one distance
    "three_lobed_bearing": ([], "rad", 0.05, "outside"),     # encoder error three times a turn
    "iron_under_floor": ([], "rad", 0.30, "outside"),        # the compass is turned near one place of the room
    "four_struts": ([], "m", 0.04, "outside"),               # window bulges between four struts: range, four times a turn
}


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


class World:
    """One room, one path, one sensor: all that is drawn but the causes."""

    def __init__(self, seed, index, core="gauss", hide=False):
        g = self.rng = np.random.default_rng([seed, index])
        self.seed, self.index, self.core = seed, index, core
        # sensor: focal length in pixels, baseline, vergence; what the firmware believes is slightly off
        self.F, self.b = g.uniform(700, 1500), g.uniform(0.06, 0.12)
        self.vergence = g.uniform(0, 0.04)
        self.b_error, self.z_error = g.normal(0, 0.01), g.normal(0, 0.003)
        self.pitch_error = g.normal(0, 0.25) / self.F
        self.sigma_px = g.uniform(0.08, 0.25)
        self.sigma_bearing = np.radians(g.uniform(0.1, 0.4))
        # room, cylinders
        self.room = g.uniform(4, 9, 2)
        L, K = int(g.integers(4, 10)), int(g.integers(12, 31))
        self.R = int(g.integers(3, 11))
        self.radius = g.uniform(0.03, 0.15, L)
        marks = []
        while len(marks) < L:
            m = g.uniform(0.2, 1, 2) * self.room * 0.95
            if all(np.hypot(*(m - o)) > 0.6 for o in marks):
                marks.append(m)
        self.marks = np.array(marks)
        self.path(g, K)
        # errors of the stops
        self.random_walk = g.random() < 0.25
        self.sigma_xy = g.uniform(0.003, 0.008) if self.random_walk else g.uniform(0.005, 0.02)
        self.sigma_h = 0.0 if g.random() < 0.2 else np.radians(g.uniform(0.2, 1.0))
        self.stop_noise = g.normal(size=(K, 3))
        self.sigma_factor = 1.0          # sigma_of_stops_guessed
        self.true_walk = self.random_walk
        # clock: driving and turning take time; the sensor sweeps from behind, counter-clockwise
        start, begin = 0.0, []
        for k in range(K):
            if k:
                a1, s, a2 = self.legs[k]
                start += self.R * SWEEP_S + s / 0.25 + (abs(a1) + abs(a2)) / 0.8 + g.uniform(0.5, 3)
            begin.append(start)
        self.begin = np.array(begin)
        # cells seen: all, as if the cylinders had different heights; with hide, a cylinder behind another one is not
        rows = []
        for k in range(K):
            v = self.marks - self.cmd[k, :2]
            D, az = np.hypot(*v.T), np.arctan2(v[:, 1], v[:, 0])
            for l in range(L):
                hidden = hide and [o for o in range(L) if o != l and D[o] < D[l]
                          and abs(wrap(az[o] - az[l])) < self.radius[o] / D[o] + self.radius[l] / D[l]]
                if not hidden:
                    bearing = wrap(az[l] - self.cmd[k, 2])
                    rows += [(self.begin[k] + (r + (bearing + np.pi) / (2 * np.pi)) * SWEEP_S, k, l, r) for r in range(self.R)]
        rows.sort()
        self.t, k, l, r = np.array(rows).T
        self.k, self.l, self.rep = k.astype(int), l.astype(int), r.astype(int)
        self.span = self.t[-1] - self.t[0]
        # temperature of the air: swings slowly by 8 to 20 K
        self.temperature = 22 + g.uniform(4, 10) * np.sin(2 * np.pi * g.uniform(0.7, 1.6) * self.t / self.span + g.uniform(0, 6.28))
        self.has_temperature = g.random() < 0.4
        self.clutter = g.uniform(0.3, 1.5, L)     # what stands behind each cylinder
        self.shape = {}
        self.distance = sense(self, {})[2]

    def path(self, g, K):
        """A loop, a zigzag or a walk between via points, as turn, drive, turn."""
        kind = self.kind = str(g.choice(["loop", "zigzag", "walk"]))
        W, H = self.room
        while True:
            s = np.arange(K) / K
            if kind == "loop":
                c, a = self.room * g.uniform(0.4, 0.6, 2), self.room * g.uniform(0.2, 0.38, 2)
                ang = 2 * np.pi * g.choice([-1, 1]) * (s + g.random())
                q = c + a * np.column_stack([np.cos(ang), np.sin(ang) + g.uniform(-0.3, 0.3) * np.sin(2 * ang)])
            elif kind == "zigzag":
                n = int(g.integers(3, 6))
                q = np.column_stack([0.12 * W + 0.76 * W * s, H * (0.2 + 0.6 * np.abs((s * n) % 2 - 1))])
            else:
                n = int(g.integers(4, 8))
                via = g.uniform(0.1, 0.9, (n, 2)) * self.room
                x = s * (n - 1)
                q = np.column_stack([np.interp(x, range(n), via[:, j]) for j in (0, 1)])
            q = q + g.normal(0, 0.08, q.shape)
            # away from the cylinders; a stop too near is pushed out
            for _ in range(30):
                for m, r in zip(self.marks, self.radius):
                    v = q - m
                    D = np.hypot(*v.T)
                    near = D < r + 0.35
                    q[near] = m + v[near] / D[near, None] * (r + 0.4)
            gap = np.hypot(*(q[:, None] - self.marks[None]).transpose(2, 0, 1)) - self.radius
            if gap.min() > 0.3:
                break
        way = np.arctan2(*np.diff(q, axis=0).T[::-1])
        way = np.append(way[:1], way)
        turned = g.uniform(-np.pi, np.pi, K) if g.random() < 0.5 else g.normal(0, 0.5, K)
        self.cmd = np.column_stack([q, wrap(way + turned)])
        self.legs = [None]
        for k in range(1, K):
            a1 = wrap(way[k] - self.cmd[k - 1, 2])
            # the mast's cable must not wind up: in all the robot turns the short way from heading to heading
            a2 = wrap(self.cmd[k, 2] - self.cmd[k - 1, 2]) - a1
            self.legs.append((a1, float(np.hypot(*(q[k] - q[k - 1]))), a2))

    def constants(self, cause):
        """What a cause has besides its size: phases, which landmark, which stop. Drawn once per world."""
        if cause not in self.shape:
            g = np.random.default_rng([self.seed, self.index, 1 + list(CAUSES).index(cause)])
            K, L = len(self.cmd), len(self.marks)
            d = self.distance
            self.shape[cause] = {
                "sign": float(g.choice([-1, 1])), "phase": g.uniform(-np.pi, np.pi), "landmark": int(g.integers(L)),
                "from_stop": int(g.integers(K // 4, 3 * K // 4 + 1)), "rate": g.uniform(0.15, 0.4),
                "half_width": g.uniform(0.35, 0.8), "at_distance": float(np.quantile(d, g.uniform(0.25, 0.5))),
                "width": g.uniform(0.15, 0.3), "period": g.uniform(0.8, 2.5), "u": g.random(3),
                "place": self.cmd[int(g.integers(K)), :2] + g.normal(0, 0.2, 2)}
        return self.shape[cause]


def drive(w, c):
    """Poses that the robot takes, leg by leg: turn on the spot, drive, turn; wheel by wheel."""
    pose = w.cmd[0] + 0.0
    sxy, sh = w.sigma_xy * w.sigma_factor, w.sigma_h
    first = np.array([sxy, sxy, sh]) * w.stop_noise[0]
    out = [pose + first]
    pose = out[0].copy() if w.true_walk else pose
    unequal, radius, track = (c.get(n, 0.0) for n in ("unequal_wheels", "wheel_radius", "track_width"))
    for k in range(1, len(w.cmd)):
        h0 = pose[2]
        for j, (turn, dist) in enumerate(((w.legs[k][0], 0), (0, w.legs[k][1]), (w.legs[k][2], 0))):
            if j == 1 and "wheels_slip_once" in c and k == w.constants("wheels_slip_once")["from_stop"]:
                dist -= c["wheels_slip_once"]
            dist *= 1 + radius           # both wheels larger; turns are closed by a gyro and stay right
            left, right = dist - turn * TRACK_M / 2, dist + turn * TRACK_M / 2
            left, right = left * (1 - unequal / 2), right * (1 + unequal / 2)
            ds, dh = (left + right) / 2, (right - left) / (TRACK_M * (1 + track))
            lean = 0.0
            if "gyro_drifts" in c:       # the gyro holds the course, the course turns
                lean = c["gyro_drifts"] * (w.begin[k] + w.begin[k - 1]) / 2 / w.span
            chord = ds * np.sinc(dh / 2 / np.pi)
            pose = pose + [chord * np.cos(pose[2] + dh / 2 + lean), chord * np.sin(pose[2] + dh / 2 + lean), dh]
        e = np.array([sxy, sxy, sh]) * w.stop_noise[k]
        if w.true_walk:                  # the error of a step lies in the frame of the stop before, and stays
            ch, s = np.cos(h0), np.sin(h0)
            pose = pose + [ch * e[0] - s * e[1], s * e[0] + ch * e[1], e[2]]
            out.append(pose)
        else:
            out.append(pose + e)
    out = np.array(out)
    out[:, 2] = w.cmd[:, 2] + wrap(out[:, 2] - w.cmd[:, 2])
    return out


def sense(w, c, d_stop=0.0, d_mark=0.0, alpha=(), stops=None):
    """Noise-free range, bearing and true distance of every reading, with the causes c = {id: size}."""
    A = lambda name: w.constants(name)
    k, l, t, T = w.k, w.l, w.t, w.temperature - 22
    part = t / w.span                                       # time, as a share of the recording
    pose = (drive(w, c) if stops is None else stops) + d_stop
    p, h = pose[k, :2], pose[k, 2]
    if "gyro_drifts" in c:
        h = h + c["gyro_drifts"] * part
    if "iron_under_floor" in c:
        q = A("iron_under_floor")
        h = h + c["iron_under_floor"] * np.exp(-np.sum((p - q["place"]) ** 2, 1) / (2 * 0.8 ** 2))
    m = (w.marks + d_mark)[l]
    if "cylinder_carried_away" in c:
        q = A("cylinder_carried_away")
        late = ((l == q["landmark"]) & (k >= q["from_stop"])).astype(float)
        m = m + c["cylinder_carried_away"] * late[:, None] * [np.cos(q["phase"]), np.sin(q["phase"])]
    if "sensor_beside_turning_point" in c:
        q, a = A("sensor_beside_turning_point"), c["sensor_beside_turning_point"]
        p = p + a * np.column_stack([np.cos(h + q["phase"]), np.sin(h + q["phase"])])
    # the target
    v = m - p
    D, az = np.hypot(*v.T), np.arctan2(v[:, 1], v[:, 0])
    r = w.radius[l] * (1 + c.get("radii_wrong", 0.0))
    if "one_radius_wrong" in c:
        r = r + c["one_radius_wrong"] * (l == A("one_radius_wrong")["landmark"])
    if "oval_cylinder" in c:                                # polar radius of an ellipse, where the central beam meets it
        q, e = A("oval_cylinder"), c["oval_cylinder"] * (l == A("oval_cylinder")["landmark"])
        a, b = r * (1 + e), r * (1 - e)
        r = a * b / np.hypot(b * np.cos(az - q["phase"]), a * np.sin(az - q["phase"]))
    # the beam: it may pass beside the axis; it aims at the cylinder's axis all the same
    o = c.get("beam_beside_axis", 0.0)
    phi, d = wrap(az - h) - np.arcsin(o / D), np.sqrt(D ** 2 - o ** 2) - r
    if "mean_of_the_arc" in c:                              # mean over beams that hit, evenly spaced in angle
        u = np.linspace(-1, 1, 31)[:, None] * abs(c["mean_of_the_arc"]) * np.arcsin(r / D)
        d = np.mean(D * np.cos(u) - np.sqrt(np.maximum(r ** 2 - (D * np.sin(u)) ** 2, 0)), 0)
    if "scan_plane_tilted" in c:                            # vertical cylinders cut by a plane turned about the axis psi
        tau, psi = c["scan_plane_tilted"], A("scan_plane_tilted")["phase"]
        inplane = np.arctan2(np.sin(phi - psi), np.cos(tau) * np.cos(phi - psi))
        d, phi = d / np.sqrt(1 - (np.sin(tau) * np.sin(inplane)) ** 2), inplane + psi
    path = d
    if "cone_mirror_off_axis" in c:                         # a fixed 45 degree cone e off the axis: one leg gains e cos
        path = path + c["cone_mirror_off_axis"] * np.cos(phi - A("cone_mirror_off_axis")["phase"])
    if "four_struts" in c:
        path = path + c["four_struts"] * np.cos(4 * (phi - A("four_struts")["phase"]))
    if "translucent_cylinder" in c:
        path = path + abs(c["translucent_cylinder"]) * (l == A("translucent_cylinder")["landmark"])
    if "warm_up_of_delay" in c:
        path = path + c["warm_up_of_delay"] * (1 - np.exp(-part / A("warm_up_of_delay")["rate"]))
    path = path + c.get("delay_with_temperature", 0.0) * T
    if "multipath_bump" in c:
        q = A("multipath_bump")
        path = path + c["multipath_bump"] * np.exp(-((d - q["at_distance"]) / q["width"]) ** 2 / 2)
    if "phase_crosstalk" in c:                              # the leak's phasor is added to the echo's
        q, e = A("phase_crosstalk"), c["phase_crosstalk"]
        a = 2 * np.pi * d / q["period"]
        path = path + q["period"] / (2 * np.pi) * np.arctan2(e * np.sin(q["phase"] - a), 1 + e * np.cos(q["phase"] - a))
    # triangulation: the spot on the detector, in pixels, and the distance that the firmware makes of it
    b = w.b * (1 + w.b_error) / (1 - c.get("baseline_expands", 0.0) * T)
    u = w.F * np.tan(np.arctan2(b, path + w.z_error) - w.vergence - w.pitch_error)
    if "lens_barrel" in c:                                  # the edge: where a spot at 0.3 m falls
        u = u * (1 - c["lens_barrel"] * (u / (w.F * w.b / 0.3)) ** 2)
    if "peak_pulled_to_pixel" in c:
        u = u + c["peak_pulled_to_pixel"] * np.sin(2 * np.pi * (u - A("peak_pulled_to_pixel")["phase"]))
    if "near_exposure" in c:
        u = u + c["near_exposure"] * (d < A("near_exposure")["at_distance"])
    if "warm_up_of_pointing" in c:
        u = u + c["warm_up_of_pointing"] * (1 - np.exp(-part / A("warm_up_of_pointing")["rate"]))
    u = u + c.get("pointing_with_temperature", 0.0) * T
    if "lamp_in_sector" in c:
        u = u + c["lamp_in_sector"] * in_sector(w, phi)
    if "glossy_cylinder" in c:
        u = u + c["glossy_cylinder"] * (l == A("glossy_cylinder")["landmark"])
    y = w.b / np.tan(np.maximum(np.arctan(u / w.F) + w.vergence, 1e-3))
    y = y + sum(a * d ** i for i, a in enumerate(alpha))    # only for the Jacobian of the seed model
    # the turntable and its encoder
    phi = wrap(phi)
    if "encoder_off_centre" in c:                           # the reading head looks at a ring whose centre is e off
        e, q = c["encoder_off_centre"], A("encoder_off_centre")["phase"]
        phi = np.arctan2(np.sin(phi) + e * np.sin(q), np.cos(phi) + e * np.cos(q))
    if "encoder_on_bent_joint" in c:                        # a Cardan joint bent by beta: tan out = cos beta tan in
        q = A("encoder_on_bent_joint")["phase"]
        phi = q + np.arctan2(np.cos(c["encoder_on_bent_joint"]) * np.sin(phi - q), np.cos(phi - q))
    phi = wrap(phi) * (1 + c.get("turntable_gear_ratio", 0.0))
    phi = phi + c.get("yaw_of_mount", 0.0) + c.get("encoder_zero_creeps", 0.0) * part
    if "mount_swings_out" in c:                             # rubber feet creep back: exp(-t / tau), tau of 1 to 2.5 sweeps
        tau = SWEEP_S * (1 + 4 * (A("mount_swings_out")["rate"] - 0.15) * 1.5)
        phi = phi + c["mount_swings_out"] * np.exp(-(t - w.begin[k]) / tau)
    if "three_lobed_bearing" in c:
        phi = phi + c["three_lobed_bearing"] * np.sin(3 * (phi - A("three_lobed_bearing")["phase"]))
    if "turntable_backlash" in c:
        phi = phi + c["turntable_backlash"] * (1 - 2 * (w.rep % 2))
    return y, phi, d


def in_sector(w, phi):
    q = w.constants("lamp_in_sector")
    return (np.abs(wrap(phi - q["phase"])) < q["half_width"]).astype(float)


class Judge:
    """How much of a cause the seed model cannot take up: noncentrality of what is left, in units of the noise."""

    def __init__(self, w, noise=()):
        self.w, noise = w, dict(noise)
        self.stops = drive(w, {})
        y, b, d = sense(w, {})
        self.sy, self.sb = w.sigma_px * d ** 2 / (w.F * w.b), np.full(len(d), w.sigma_bearing)
        # a noise cause makes the others harder to see; an error shared by a cell counts R times
        if "weak_spot" in noise:
            self.sy = noise["weak_spot"] * d ** 2 / np.quantile(d, 0.75)
        if "dark_cylinder" in noise:
            self.sy = self.sy * np.where(w.l == w.constants("dark_cylinder")["landmark"], noise["dark_cylinder"], 1.0)
        rho = max(noise.get("filter_per_beam", 0.0), noise.get("pointing_wanders", 0.0))
        more = 1 + w.R * noise.get("speckle", 0.0) ** 2 + (noise.get("centroid_rounded", 0.0) / w.sigma_px) ** 2 / 12
        self.sy = np.sqrt(self.sy ** 2 * more * (1 + rho) / (1 - rho)
                          + (noise.get("noise_floor", 0.0) * np.median(self.sy)) ** 2 + noise.get("output_rounded", 0.0) ** 2 / 12)
        self.sb = np.sqrt(self.sb ** 2 + w.R * noise.get("beam_grid", 0.0) ** 2 / 12)
        self.walk = w.random_walk or "slip_adds_up" in noise
        self.looser = max(noise.get("slip_adds_up", 1.0), noise.get("sigma_of_stops_guessed", 1.0))
        K, L = len(w.cmd), len(w.marks)
        columns = [self.white(d ** i, 0 * d, np.zeros(self.prior(self.stops).shape)) for i in range(4)]
        for j in range(3 if w.sigma_h else 2):
            for k in range(K):
                e = np.zeros((K, 3))
                e[k, j] = 1e-5
                columns.append(self.central(e, np.zeros((L, 2)), 1e-5))
        for l in range(L):
            for j in range(2):
                e = np.zeros((L, 2))
                e[l, j] = 1e-5
                columns.append(self.central(np.zeros((K, 3)), e, 1e-5))
        J = np.column_stack(columns)
        size = np.linalg.norm(J, axis=0)
        U, S, V = np.linalg.svd(J / size, full_matrices=False)
        keep = S > 1e-10 * S[0]
        self.Q, self.inverse = U[:, keep], (V[keep].T / S[keep]) @ U[:, keep].T / size[:, None]
        self.prior_rows = len(J) - 2 * len(y)
        self.base = (y, b)

    def white(self, dy, db, prior):
        return np.concatenate([dy / self.sy, db / self.sb, prior])

    def prior(self, s):
        w = self.w
        sh = w.sigma_h or 1e-9
        e = s - w.cmd
        if self.walk:
            def steps(x):
                D, c, n = np.diff(x[:, :2], axis=0), np.cos(x[:-1, 2]), np.sin(x[:-1, 2])
                return np.column_stack([c * D[:, 0] + n * D[:, 1], -n * D[:, 0] + c * D[:, 1], np.diff(x[:, 2])])
            e = np.vstack([e[:1], steps(s) - steps(w.cmd)])
        e = e / (self.looser * np.array([w.sigma_xy, w.sigma_xy, sh]))
        return e.ravel() if w.sigma_h else e[:, :2].ravel()

    def central(self, ds, dm, h):
        a, b = (sense(self.w, {}, q * ds, q * dm, stops=self.stops) for q in (1, -1))
        pr = self.prior(self.stops + ds) - self.prior(self.stops - ds)
        return self.white(a[0] - b[0], wrap(a[1] - b[1]), pr) / (2 * h)

    def change(self, c):
        """Whitened change of all readings, less what the seed model takes up: refitted, as stops may move by a lot."""
        w = self.w
        K, L, columns = len(w.cmd), len(w.marks), 3 if w.sigma_h else 2
        y, b, _ = sense(w, c)
        x, prior0, best = np.zeros(self.inverse.shape[0]), self.prior(self.stops), None
        for _ in range(8):
            ds = np.zeros((K, 3))
            ds[:, :columns] = x[4:4 + columns * K].reshape(columns, K).T
            m = sense(w, {}, ds, x[-2 * L:].reshape(L, 2), x[:4], stops=self.stops)
            v = self.white(y - m[0], wrap(b - m[1]), prior0 - self.prior(self.stops + ds))
            if best is not None and not v @ v < 0.999 * (best @ best):
                best = v if v @ v < best @ best else best
                break
            best, x = v, x + self.inverse @ v
        return best - self.Q @ (self.Q.T @ best)

    def curve_rest(self):
        """Noncentrality of the clean curve beyond orders 2 and 3."""
        y, _, d = sense(self.w, {})
        return [float(np.sum(((y - np.polyval(np.polyfit(d, y, n, w=1 / self.sy), d)) / self.sy) ** 2)) for n in (2, 3)]

    def scale(self, cause, wanted):
        """The size with the wanted noncentrality, or None where the largest sensible size falls short of it."""
        sign = self.w.constants(cause)["sign"]
        if cause == "mean_of_the_arc":
            sign = 1.0
        size = lambda s: float(np.sum(self.change({cause: sign * s}) ** 2))
        low, high = 0.0, CAUSES[cause][2]
        if not size(high) >= wanted:
            return None
        for _ in range(30):
            mid = (low + high) / 2
            low, high = (mid, high) if size(mid) < wanted else (low, mid)
        return sign * high

    def left(self, c, names):
        """What is left of the planted change once the causes of these names, as built here, are fitted too (linearised):
        phases freely, landmark, stop and rate at their best. Below 7 the names are twins of what was planted."""
        w, rest, basis = self.w, self.change(c), []
        for cause in [n for n in CAUSES if CAUSES[n][3] == "mean" and set(CAUSES[n][0]) & set(names)]:
            own, best = dict(w.constants(cause)), None
            small = 0.3 * (c.get(cause) or self.scale(cause, 150.0) or CAUSES[cause][2])
            variants = [own] + [dict(own, landmark=l) for l in range(len(w.marks))] * ("cylinder" in cause or "radius" in cause) \
                + [dict(own, from_stop=k) for k in range(2, len(w.cmd) - 1)] * (cause == "wheels_slip_once")
            for v in variants:
                columns = []
                for turn in (0.0, np.pi / 4, np.pi / 2):
                    w.shape[cause] = dict(v, phase=v["phase"] + turn)
                    columns.append(self.change({cause: small}))
                M = np.column_stack(basis + columns)
                x = rest - M @ np.linalg.lstsq(M, rest, rcond=1e-9)[0]
                if best is None or x @ x < best[0]:
                    best = (float(x @ x), columns)
            w.shape[cause] = own
            basis += best[1]
        if not basis:
            return float(rest @ rest)
        M = np.column_stack(basis)
        x = rest - M @ np.linalg.lstsq(M, rest, rcond=1e-9)[0]
        return float(x @ x)

    def beside(self, c):
        """Noncentrality of each of several causes beside the others."""
        v = {n: self.change({n: s}) for n, s in c.items()}
        out = {}
        for n in v:
            others = [v[o] for o in v if o != n]
            x = v[n]
            if others:
                M = np.column_stack(others)
                x = x - M @ np.linalg.lstsq(M, x, rcond=None)[0]
            out[n] = float(np.sum(x ** 2))
        return out


def possible(w, cause):
    if cause in ("baseline_expands", "delay_with_temperature", "pointing_with_temperature"):
        w.has_temperature = True             # a sensor that minds the temperature is recorded with it
    return not (cause in ("mount_swings_out", "turntable_backlash") and w.R < 4
                or cause in ("speckle", "filter_per_beam") and w.R < 4
                or cause in ("slip_adds_up", "sigma_of_stops_guessed") and w.random_walk)


def plant(w, wanted, count, names, pool, least_beside=60.0):
    """Draws causes and their sizes. A cause that cannot be made visible is dropped, noted, and another one drawn."""
    g, dropped = w.rng, []
    order = list(names) or [str(n) for n in g.permutation(pool)]
    clash = lambda a, b: bool(set(CAUSES[a][0]) & set(CAUSES[b][0])) or CAUSES[a][3] == "noise" == CAUSES[b][3]
    chosen = []
    for n in order:
        if len(chosen) < count and not any(clash(n, o) for o in chosen):
            if possible(w, n):
                chosen.append(n)
            else:
                dropped.append(n)
    sizes = {n: noise_size(w, n) for n in chosen if CAUSES[n][3] == "noise"}
    judge = Judge(w, sizes)
    queue = [n for n in chosen if n not in sizes] + [n for n in order if n not in chosen + dropped and CAUSES[n][3] != "noise"]
    lam = {}
    for cause in queue:
        if len(sizes) == count:
            break
        if any(clash(cause, o) for o in sizes) or not possible(w, cause):
            continue
        size = judge.scale(cause, wanted)
        if size is None:
            dropped.append(cause)
            continue
        trial = {n: s for n, s in sizes.items() if CAUSES[n][3] != "noise"} | {cause: size}
        good = True
        for _ in range(4):                   # larger, where the others take up too much
            left = judge.beside(trial)
            short = [n for n in left if left[n] < least_beside]
            if not short:
                break
            for n in short:
                trial[n] *= 1.05 * np.sqrt(least_beside / max(left[n], 1e-6))
                good &= bool(abs(trial[n]) <= CAUSES[n][2])
            if not good:
                break
        if not good or min(judge.beside(trial).values()) < least_beside:
            dropped.append(cause)
            continue
        sizes.update(trial)
    means = {n: s for n, s in sizes.items() if CAUSES[n][3] != "noise"}
    alone = {n: float(np.sum(judge.change({n: s}) ** 2)) for n, s in means.items()}
    left = judge.beside(means)
    for n in means:
        lam[n] = (alone[n], left[n])
    return judge, sizes, lam, dropped


def noise_size(w, cause):
    a, b, _ = w.constants(cause)["u"]
    spread = {"centroid_rounded": w.sigma_px * (1.5 + 1.5 * a),
              "output_rounded": (0.01, 0.02)[a > 0.5],
              "beam_grid": 2 * np.pi / round(2 * np.pi / max(np.radians(0.5), w.sigma_bearing * (1.5 + 1.5 * a))),
              "speckle": 0.5 + 0.5 * a, "filter_per_beam": 0.5 + 0.3 * a, "pointing_wanders": 0.5 + 0.3 * a,
              "dark_cylinder": 2 + a, "noise_floor": 0.6 + 0.6 * a,
              "sigma_of_stops_guessed": 2 + a if b < 0.7 else 0.4, "slip_adds_up": 1 + a}
    return float(spread.get(cause, CAUSES[cause][2]))


def record(w, c):
    """Readings with noise, labels, and the order in which they were taken."""
    g = np.random.default_rng([w.seed, w.index, 1000])
    if "sigma_of_stops_guessed" in c:
        w.sigma_factor = c["sigma_of_stops_guessed"]
    if "slip_adds_up" in c:
        w.true_walk, w.sigma_factor = True, c["slip_adds_up"]
    y, b, d = sense(w, c)
    n = len(y)
    draw = {"gauss": g.normal, "laplace": lambda size: g.laplace(0, np.sqrt(0.5), size),
            "logistic": lambda size: g.logistic(0, np.sqrt(3) / np.pi, size)}[w.core]
    px = draw(size=n)                                       # noise of the spot's place, in units of its sigma
    if "filter_per_beam" in c:                              # the driver smooths each direction over the sweeps
        rho, last = c["filter_per_beam"], {}
        for i in range(n):
            cell = (w.k[i], w.l[i])
            if cell in last:
                px[i] = rho * last[cell] + np.sqrt(1 - rho ** 2) * px[i]
            last[cell] = px[i]
    if "pointing_wanders" in c:                             # the laser's pointing wanders from reading to reading
        rho = c["pointing_wanders"]
        for i in range(1, n):
            if w.k[i] == w.k[i - 1]:
                px[i] = rho * px[i - 1] + np.sqrt(1 - rho ** 2) * px[i]
    if "speckle" in c:                                      # speckle stands still while the robot stands
        still = g.normal(size=(len(w.cmd), len(w.marks)))
        px = px + c["speckle"] * still[w.k, w.l]
    if "dark_cylinder" in c:
        px = px * np.where(w.l == w.constants("dark_cylinder")["landmark"], c["dark_cylinder"], 1.0)
    if "lamp_in_sector" in c:                               # its light is noise too
        px = px * np.where(in_sector(w, b) > 0, 1.5 + 0.5 * w.constants("lamp_in_sector")["u"][0], 1.0)
    per_px = d ** 2 / (w.F * w.b)                           # metres per pixel
    if "weak_spot" in c:                                    # strong noise before the division, which makes it skew
        sigma = c["weak_spot"] * w.F * w.b / np.quantile(d, 0.75)
        y = w.b / np.tan(np.maximum(np.arctan2(w.b, y) + sigma * px / w.F, 0.3 * w.b / y))
    else:
        y = y + w.sigma_px * per_px * px
    if "noise_floor" in c:
        y = y + c["noise_floor"] * np.median(w.sigma_px * per_px) * g.normal(size=n)
    hit = lambda share: g.random(n) < share
    if "clutter_behind" in c:
        i = hit(c["clutter_behind"])
        y[i] += (g.uniform(0.2, 1, n) * w.clutter[w.l])[i]
    if "dust" in c:
        i = hit(c["dust"])
        y[i] = g.uniform(0.12, d)[i]
    if "other_lidar" in c:
        i = hit(c["other_lidar"])
        y[i] = g.uniform(0.12, float(np.hypot(*w.room)), n)[i]
    if "edges_cut_the_spot" in c:                           # more often on targets that look thin
        thin = d / w.radius[w.l]
        i = hit(np.minimum(c["edges_cut_the_spot"] * thin / thin.mean(), 0.5))
        y[i] += (g.uniform(0.1, 1, n) * w.clutter[w.l])[i]
    if "centroid_rounded" in c:
        u = w.F * w.b / y
        y = w.F * w.b / np.maximum(np.round(u / c["centroid_rounded"]) * c["centroid_rounded"], 1e-6)
    if "output_rounded" in c:
        y = np.round(y / c["output_rounded"]) * c["output_rounded"]
    b = b + w.sigma_bearing * g.normal(size=n)
    if "beam_grid" in c:
        b = np.round(b / c["beam_grid"]) * c["beam_grid"]
    label = w.l.copy()
    if "labels_exchanged" in c:
        q = w.constants("labels_exchanged")
        first = q["landmark"]
        second = (first + 1 + int(q["u"][0] * (len(w.marks) - 1))) % len(w.marks)
        for k in g.choice(len(w.cmd), int(c["labels_exchanged"]), replace=False):
            at = w.k == k
            label[at & (w.l == first)], label[at & (w.l == second)] = second, first
    return y, wrap(b), label


def write(folder, w, y, b, label):
    out = os.path.join(folder, "recording")
    os.makedirs(out, exist_ok=True)
    name = lambda l: "C%d" % (l + 1)
    with open(os.path.join(out, "recording.yaml"), "w") as f:
        f.write("format: rangecal/1\nkind: landmarks\n"
                "sensor: {name: other, principle: triangulation, range_min_m: 0.1, range_max_m: 30.0}\n"
                "stops: {sigma_xy_m: %.6g, sigma_heading_rad: %.6g, error: %s}\n"
                % (w.sigma_xy, w.sigma_h, "random_walk" if w.random_walk else "independent"))
    with open(os.path.join(out, "stops.csv"), "w") as f:
        f.write("stop,x_m,y_m,heading_rad\n")
        f.writelines("%d,%.6f,%.6f,%.7f\n" % (k, *q) for k, q in enumerate(w.cmd))
    with open(os.path.join(out, "landmarks.csv"), "w") as f:
        f.write("landmark,radius_m\n")
        f.writelines("%s,%.5f\n" % (name(l), r) for l, r in enumerate(w.radius))
    with open(os.path.join(out, "observations.csv"), "w") as f:
        f.write("stop,landmark,repeat,time_s,range_m,bearing_rad" + (",temperature_c" if w.has_temperature else "") + "\n")
        for i in range(len(y)):
            extra = ",%.3f" % w.temperature[i] if w.has_temperature else ""
            f.write("%d,%s,%d,%.4f,%.6f,%.7f%s\n" % (w.k[i], name(label[i]), w.rep[i], w.t[i], y[i], b[i], extra))


def make(folder, seed, index, count=0, names=(), wanted=150.0, core="gauss", outside=False, hide=False):
    w = World(seed, index, core, hide)
    pool = [n for n in CAUSES if (CAUSES[n][3] == "outside") == outside]
    judge, sizes, lam, dropped = plant(w, wanted, len(names) or count, names, pool)
    truth = {"seed": seed, "world": index, "core": core, "hide": hide, "path": w.kind, "stops": len(w.cmd), "landmarks": len(w.marks),
             "repeats": w.R, "readings": len(w.t), "error": "random_walk" if w.random_walk else "independent",
             "sigma_heading_rad": w.sigma_h, "curve_beyond_order_2_and_3": judge.curve_rest(), "dropped": dropped,
             "causes": [{"cause": n, "ids": CAUSES[n][0], "size": sizes[n], "unit": CAUSES[n][1],
                         "lambda": lam.get(n, (None, None))[0], "lambda_beside": lam.get(n, (None, None))[1],
                         "constants": {k: (v.tolist() if hasattr(v, "tolist") else v) for k, v in w.constants(n).items()}}
                        for n in sizes]}
    write(folder, w, *record(w, sizes))
    with open(os.path.join(folder, "truth.json"), "w") as f:
        json.dump(truth, f, indent=1)
    return truth


def left_of(truth, names):
    """Noncentrality of what was planted on the means that these names, as built here, leave."""
    w = World(truth["seed"], truth["world"], truth["core"], truth["hide"])
    c = {x["cause"]: x["size"] for x in truth["causes"]}
    noise = {n: s for n, s in c.items() if CAUSES[n][3] == "noise"}
    return Judge(w, noise).left({n: s for n, s in c.items() if n not in noise}, names)


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("folder")
    a.add_argument("--seed", type=int, required=True)
    a.add_argument("--world", type=int, required=True)
    a.add_argument("--causes", type=int, default=0, help="so many causes, drawn")
    a.add_argument("--cause", nargs="+", default=[], choices=list(CAUSES), metavar="ID", help="these causes")
    a.add_argument("--outside", action="store_true", help="draw from the causes that no name says")
    a.add_argument("--hide", action="store_true", help="cylinders hide each other: cells are missing")
    a.add_argument("--lambda", dest="wanted", type=float, default=150.0, help="noncentrality of each cause alone")
    a.add_argument("--core", choices=["gauss", "laplace", "logistic"], default="gauss")
    a = a.parse_args()
    truth = make(a.folder, a.seed, a.world, a.causes, a.cause, a.wanted, a.core, a.outside, a.hide)
    json.dump(truth["causes"], sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
