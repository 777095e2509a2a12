# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of recordings and results, by matplotlib. Lengths in metres, small ones in millimetres."""
import numpy as np

from . import _take
from ._native import InputError, radius95, z95


def _axes(ax, **size):
    if ax is not None:
        return ax
    from matplotlib import pyplot
    return pyplot.subplots(**{"figsize": (6.4, 4.0), "layout": "constrained", **size})[1]


def recording(self, ax=None):
    """The readings in the plane as read from the commanded stops, of ranges alone the stops; of pairs, reading minus true distance."""
    ax = _axes(ax)
    if self.kind == "pairs":
        ax.plot(self.true_m, 1e3 * (self.range_m - self.true_m), ".", markersize=3)
        ax.set(xlabel="true distance [m]", ylabel="reading - true [mm]")
        return ax
    stops = np.asarray(self.stops)
    radius = np.asarray(self.landmark_radius_m)[self.landmark]
    reach = self.range_m + radius
    for index, label in enumerate(self.landmark_labels):
        if self.bearing_rad is None:
            continue
        direction = stops[self.stop, 2] + self.bearing_rad
        mine = self.landmark == index
        ax.plot((stops[self.stop, 0] + reach * np.cos(direction))[mine],
                (stops[self.stop, 1] + reach * np.sin(direction))[mine], ".", markersize=3, label=label)
    ax.plot(stops[:, 0], stops[:, 1], "k^", markersize=5, label="stops")
    if self.true_landmarks is not None:
        ax.plot(*self.true_landmarks.T, "k+", markersize=10, label="true landmarks")
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.02, 0.5))
    return ax


def _curve(ax, calibration, color, label):
    """f(d) - d as a line; returns distances, the line and its standard deviation [mm]."""
    d = np.linspace(*calibration.range_m, 200)
    bias, std = 1e3 * (calibration.f(d) - d), 1e3 * calibration.f_std(d)
    ax.plot(d, bias, color=color, label=label)
    ax.set(xlabel="true distance d [m]", ylabel="f(d) - d [mm]")
    return d, bias, std


def calibration(self, ax=None):
    """f(d) - d with its 95 % band, and the spread of one reading around it (one standard deviation, pale)."""
    ax = _axes(ax)
    if len(self.alpha):
        d, bias, std = _curve(ax, self, "C0", f"{self.method}, order {self.order}")
        spread = 1e3 * self.noise(d)
        ax.fill_between(d, bias - z95 * std, bias + z95 * std, color="C0", alpha=0.35, linewidth=0)
        ax.fill_between(d, bias - spread, bias + spread, color="C0", alpha=0.12, linewidth=0)
        ax.axhline(0.0, color="0.6", linewidth=0.8)
        ax.legend(fontsize="small")
    return ax


def scene(self, ax=None):
    """Stops and landmarks as estimated, landmarks with their 95 % ellipses."""
    ax = _axes(ax)
    turn = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = radius95 * np.stack([np.cos(turn), np.sin(turn)])
    for label, position, covariance in zip(self.landmark_labels, self.landmarks, self.landmark_covariance):
        if np.all(np.isfinite(covariance)):
            values, vectors = np.linalg.eigh(covariance)
            ellipse = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
            ax.plot(position[0] + ellipse[0], position[1] + ellipse[1], color="C1", linewidth=1.0)
        ax.plot(*position, "C1+")
        ax.annotate(label, position, textcoords="offset points", xytext=(4, 4), fontsize="small")
    if len(self.stops):
        ax.plot(self.stops[:, 0], self.stops[:, 1], "C0^", markersize=4)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    return ax


def comparison(self, ax=None):
    """f(d) - d of every method; the ends of its 95 % band are dotted."""
    ax = _axes(ax)
    for i, one in enumerate(self.calibrations):
        if one.usable:
            d, bias, std = _curve(ax, one, f"C{i}", one.method)
            for sign in (-1.0, 1.0):
                ax.plot(d, bias + sign * z95 * std, ":", color=f"C{i}", linewidth=1.0)
    ax.axhline(0.0, color="0.6", linewidth=0.8)
    ax.legend(fontsize="small")
    return ax


def corrected(self, ax=None):
    """Corrected minus raw over the raw reading, with one standard deviation."""
    ax = _axes(ax)
    ax.errorbar(self.reading_m, 1e3 * (self.distance_m - self.reading_m), 1e3 * self.std_m, fmt=".", markersize=3,
                elinewidth=0.6)
    ax.set(xlabel="reading [m]", ylabel="corrected - raw [mm]")
    return ax


def residuals(self, along="range", channel="range", bins=20, ax=None):
    """Residuals over a covariate, with binned means and the 95 % interval of each mean.

    Parameters
    ----------
    along : str
        ``"range"``, or a covariate that `residuals` was asked for.
    channel : {"range", "bearing"}
        Range residuals [mm] or bearing residuals [degrees].
    bins : int
        Of equally many readings each.
    """
    known = {"range": self.distance_m, **self.along}
    if along not in known:
        raise InputError(f"along is '{along}'; at hand are {', '.join(known)} (see residuals(..., along=[...]))")
    _take.choice("channel", channel, ("range", "bearing"))
    bins = _take.whole("bins", bins, 1)
    ax = _axes(ax)
    x = np.asarray(known[along])
    y, unit = (1e3 * self.range_residual_m, "mm") if channel == "range" else \
        (np.degrees(self.bearing_residual_rad), "deg")
    ax.plot(x, y, ".", color="0.7", markersize=2)
    order = np.argsort(x, kind="stable")
    for part in np.array_split(order, min(bins, max(1, len(order) // 5))):
        std = np.std(y[part], ddof=1) / np.sqrt(len(part)) if len(part) > 1 else 0.0
        ax.errorbar(np.mean(x[part]), np.mean(y[part]), z95 * std, fmt="o", color="C0", markersize=4)
    ax.axhline(0.0, color="0.3", linewidth=0.8)
    ax.set(xlabel=_axis_label(along), ylabel=f"{channel} residual [{unit}]")
    return ax


def diagnosis(self, finding=0, ax=None):
    """Binned residuals along a located covariate, before and after the model was completed.

    Parameters
    ----------
    finding : int
        Index into ``location``.
    """
    ax = _axes(ax)
    if not self.location:
        ax.set_title(self.sentence, fontsize="small", wrap=True)
        return ax
    found = self.location[finding]
    scale, unit = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}.get(found.unit, (1.0, found.unit))
    for values, color, label in ((found.before, "C3", "before"), (found.after, "C0", "after")):
        ax.errorbar(found.at, scale * values, z95 * scale * found.std, fmt="o-", color=color, markersize=4,
                    linewidth=1.0, capsize=2, label=label)
    ax.axhline(0.0, color="0.3", linewidth=0.8)
    ax.set(xlabel=_axis_label(found.covariate), ylabel=f"{found.channel} residual [{unit}]")
    ax.set_title(" + ".join(self.final_effects) or "no mismatch", fontsize="small")
    ax.legend(fontsize="small")
    return ax


def study(self, x, y, ax=None):
    """One column over another, a line per estimator and per value of every other parameter that varies."""
    ax = _axes(ax)
    frame = self.to_frame()
    parameters = [name for name in frame.columns[1:list(frame.columns).index("estimator") + 1]
                  if name != x and frame[name].nunique() > 1]
    lines = frame[parameters].astype(str).agg(", ".join, axis=1) if parameters else ""
    for label, part in frame.assign(lines=lines).groupby("lines", sort=False):
        part = part.sort_values(x)
        error = part[y + "_se"] if y + "_se" in part else None
        ax.errorbar(part[x], part[y], error, fmt="o-", markersize=3, linewidth=1.0, label=label)
    ax.set(xlabel=x, ylabel=y)
    ax.legend(fontsize="x-small")
    return ax


def _axis_label(covariate):
    units = {"range": "true distance [m]", "disparity": "1 / true distance [1/m]",
             "sensor_bearing": "direction in the sensor frame [rad]", "heading": "heading [rad]", "time": "time [s]",
             "radius": "radius [m]"}
    return units.get(covariate, covariate)
