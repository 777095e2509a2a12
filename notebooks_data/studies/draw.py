#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws the figures of docs/reproduction.md and docs/which-estimator.md from the results beside this file.

usage: draw.py [FIGURE...]      figures, to docs/images/studies
       draw.py caps             the ratios (31) that the noise alone allows
Needs matplotlib (Debian: python3-matplotlib).
"""
import csv
import pathlib
import sys

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
IMAGES = HERE.parent.parent / "docs" / "images" / "studies"

STYLE = {
    "closed-form-paper": ("closed form, paper's weights", "C3", "-"),
    "closed-form-printed": ("closed form, printed", "C1", "--"),
    "closed-form-consistent": ("closed form, consistent", "C0", "-"),
    "closed-form": ("closed form", "C0", "-"),
    "approximate": ("approximate", "C2", "-."),
    "full": ("full ML", "C5", "-"),
    "marginal": ("marginal ML", "k", "-"),
}


def rows(name, **where):
    """Rows of a study's results as dicts of numbers (texts stay), those that match `where`."""

    def number(text):
        try:
            return float(text)
        except ValueError:
            return text if text else float("nan")

    found = []
    with open(HERE / "results" / f"{name}.csv", newline="") as stream:
        for row in csv.DictReader(stream):
            row = {key: number(value) for key, value in row.items()}
            if all(row[key] == value for key, value in where.items()):
                found.append(row)
    return found


def curve(name, x, y, **where):
    """x and y of the rows that match; a point that fewer than nine in ten repeats answer is left out."""
    points = [(r[x], r[y]) for r in rows(name, **where) if r["answers"] >= 0.9 * r["repeats"]]
    return np.array(points).reshape(-1, 2).T


def table(name, x, y, value, **where):
    """`value` as a matrix over the distinct x (columns) and y (rows)."""
    found = rows(name, **where)
    xs, ys = sorted({r[x] for r in found}), sorted({r[y] for r in found})
    matrix = np.full((len(ys), len(xs)), np.nan)
    for r in found:
        matrix[ys.index(r[y]), xs.index(r[x])] = value(r) if callable(value) else r[value]
    return xs, ys, matrix


def save(figure, name):
    IMAGES.mkdir(parents=True, exist_ok=True)
    figure.savefig(IMAGES / f"{name}.png", dpi=100, metadata={"Software": None})
    plt.close(figure)


def shade(axes, xs, ys, matrix, title, text, **options):
    """Cells with their values written in."""
    axes.imshow(matrix, origin="lower", aspect="auto", cmap="viridis", **options)
    axes.set_xticks(range(len(xs)), [f"{x:g}" for x in xs], rotation=45)
    axes.set_yticks(range(len(ys)), [f"{y:g}" for y in ys])
    axes.set_title(title, fontsize=9)
    middle = np.nanmean([np.nanmin(matrix), np.nanmax(matrix)]) if np.isfinite(matrix).any() else 0
    for (j, i), value in np.ndenumerate(matrix):
        color = "white" if not value > middle else "black"
        axes.text(i, j, text(value), ha="center", va="center", fontsize=7, color=color)


def fig_2016_fig4():
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for law, power in (("f", 1), ("f2", 2), ("f3", 3)):
        for divisor, line in (("printed", "-"), ("unbiased", ":")):
            x, y = curve("2016-fig4", "readings", f"h{power}_best", noise_law=law, estimator=f"noise-order-{divisor}")
            axes[0].semilogx(x, y, f"C{power}{line}", marker=".", label=f"H{power} true, {divisor}")
    axes[0].set(xlabel="readings at each of 12 distances", ylabel="share of repeats in which the true H wins")
    axes[0].legend(fontsize=7)
    (row,) = rows("2016-fig4", noise_law="f2", estimator="noise-order-printed", readings=50)
    axes[1].bar(range(4), [row[f"h{s}_log_likelihood"] for s in range(4)], color=["C7", "C7", "C2", "C7"])
    axes[1].set_xticks(range(4), [f"H{s}" for s in range(4)])
    axes[1].set(ylabel="mean log-likelihood (15)", title="H2 true, 50 readings at each distance")
    save(figure, "2016-fig4")


def fig_2016_table1():
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.4), layout="constrained", sharey=True)
    paper = np.array([-5.774, -7.380, -5.824, -3.890])
    for panel, sigma in zip(axes, (0.01, 0.03, 0.1)):
        for readings in (1, 2, 5, 10):
            (row,) = rows("2016-table1", noise_sigma=sigma, readings=readings, estimator="approximate")
            aic = np.array([row[f"aic_{n}"] for n in range(1, 5)])
            panel.plot(range(1, 5), aic - aic[1], marker=".", label=f"N = {12 * readings:.0f}")
        panel.plot(range(1, 5), paper - paper[1], "ks--", label="paper, Table 1")
        panel.set(title=rf"$\sigma_e$ = {sigma:g} /m", xlabel="order", ylim=(-2.5, 12))
        panel.set_xticks(range(1, 5))
    axes[0].set_ylabel("mean AIC less that of order 2")
    axes[0].legend(fontsize=7)
    save(figure, "2016-table1")


def fig_2016_fig8():
    figure, axes = plt.subplots(figsize=(6, 4.2), layout="constrained")
    x, y, factor = table("2016-fig8", "noise_sigma", "bias_scale", "nmse_factor", estimator="full")
    _, _, before = table("2016-fig8", "noise_sigma", "bias_scale", "nmse_before", estimator="full")
    lines = axes.contour(x, y, factor, levels=[1.5, 3, 6, 30, 100, 300, 1000], colors="C0", linewidths=0.8)
    axes.clabel(lines, fmt="%g", fontsize=7)
    ours = axes.contour(x, y, factor, levels=[17.15], colors="C3", linewidths=2)
    axes.clabel(ours, fmt="factor %g", fontsize=8)
    theirs = axes.contour(x, y, before, levels=[0.0789], colors="k", linestyles="--")
    axes.clabel(theirs, fmt="before = %g", fontsize=8)
    axes.set(xscale="log", xlabel=r"$\sigma_e$ [1/m]", ylabel="bias, in multiples of the scene's f(d) - d")
    axes.set_title("normalised MSE before / after, full ML", fontsize=9)
    save(figure, "2016-fig8")


def fig_2021_fig7():
    angles = (0.5, 1, 2, 5)
    figure, axes = plt.subplots(2, 4, figsize=(12, 5.6), layout="constrained", sharex=True, sharey="row")
    for column, angle in enumerate(angles):
        for name, (label, color, line) in STYLE.items():
            for row, value in enumerate(("landmark_bias_m", "landmark_variance_m2")):
                x, y = curve("2021-fig7", "sigma_s_m", value, estimator=name, sigma_theta_deg=angle)
                if len(x):
                    axes[row][column].loglog(x, y, color=color, linestyle=line, marker=".", label=label)
        x, y = curve("2021-fig7", "sigma_s_m", "landmark_bound_m", estimator="closed-form-consistent", sigma_theta_deg=angle)
        axes[1][column].loglog(x, y**2, color="0.5", linewidth=4, alpha=0.5, label="Cramér-Rao bound")
        x, y = curve("2021-fig7", "sigma_s_m", "landmark_bias_se_m", estimator="closed-form-paper", sigma_theta_deg=angle)
        axes[0][column].fill_between(x, 1e-4, 2 * y, color="0.9", label="within chance of no bias")
        axes[0][column].set(title=rf"$\sigma_\theta$ = {angle:g}°", ylim=(1e-4, 3))
        axes[1][column].set_xlabel(r"$\sigma_s$ [m]")
    axes[0][0].set_ylabel("bias [m]")
    axes[1][0].set_ylabel("variance [m²]")
    axes[0][0].legend(fontsize=7)
    axes[1][0].legend(fontsize=7)
    axes[1][3].text(0.03, 0.03, "full does not exist for L = 1", transform=axes[1][3].transAxes, fontsize=8)
    save(figure, "2021-fig7")


def fig_2021_fig8():
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    listed, drawn = "scenes/2021.yaml", "scenes/2021-random.yaml"
    for name in ("closed-form-paper", "closed-form-consistent", "approximate", "full", "marginal"):
        label, color, _ = STYLE[name]
        for sigma, line in ((0.01, "-"), (0.05, "--")):
            for panel, scene, value in ((0, listed, "landmark_bias_m"), (1, listed, "landmark_variance_m2"),
                                        (2, drawn, "landmark_variance_m2")):
                x, y = curve("2021-fig8", "landmarks", value, estimator=name, scene=scene, sigma_s_m=sigma)
                axes[panel].semilogy(x, y, color=color, linestyle=line, marker=".", label=f"{label}, {100 * sigma:g} cm")
    for panel, scene in ((1, listed), (2, drawn)):
        for sigma in (0.01, 0.05):
            x, y = curve("2021-fig8", "landmarks", "landmark_bound_m", estimator="marginal", scene=scene, sigma_s_m=sigma)
            axes[panel].semilogy(x, y**2, color="0.5", linewidth=4, alpha=0.5)
    axes[0].set(title="bias, landmarks listed", xlabel="L", ylabel="bias [m]")
    axes[1].set(title="variance, landmarks listed", xlabel="L", ylabel="variance [m²]")
    axes[2].set(title="variance, landmarks drawn anew", xlabel="L")
    axes[2].legend(fontsize=7, bbox_to_anchor=(1.02, 1), loc="upper left")
    axes[1].text(0.03, 0.03, "grey: bound. full does not exist for L ≤ 2", transform=axes[1].transAxes, fontsize=8)
    save(figure, "2021-fig8")


def fig_2021_fig9():
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    for panel, (name, value, title) in zip(axes, (
            ("closed-form-paper", "mse_factor", "MSE ratio, closed form, paper's weights"),
            ("marginal", "mse_factor", "MSE ratio, marginal ML"),
            ("closed-form-paper", "mse_factor_without_noise", "closed form, readings without noise"))):
        x, y, ratio = table("2021-fig9", "sigma_s_m", "sigma_theta_deg", value, estimator=name)
        shade(panel, x, y, ratio, title, lambda v: f"{v:.3g}", norm=matplotlib.colors.LogNorm())
        panel.set_xlabel(r"$\sigma_s$ [m]")
    axes[0].set_ylabel(r"$\sigma_\theta$ [°]")
    save(figure, "2021-fig9")


def distances_2021(landmarks):
    """From every stop of scenes/2021.yaml to its first landmarks [m]."""
    places = ((0.46, 0.93), (1.57, -0.55), (2.71, 1.84), (3.34, -1.36), (1.38, 2.77))[:landmarks]
    return np.concatenate([np.hypot(x - np.arange(20) * 0.2, y) for x, y in places])


def known_curve_ratio(d, sigma):
    """The ratio (31) of the true curve at distances d [m], noise sigma f(d): what no calibration can pass. First order
    in the noise."""
    alpha = np.array([0.0525, 0.8838, 0.0584])
    f, slope = alpha[0] + d * (alpha[1] + d * alpha[2]), alpha[1] + 2 * alpha[2] * d
    return np.mean((f - d) ** 2 + (sigma * f) ** 2) / np.mean((sigma * f / slope) ** 2)


def fig_2021_fig9_readings():
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for angle, color in ((0.1, "C0"), (0.5, "C2"), (2, "C3")):
        for name, line in (("closed-form-paper", "-"), ("marginal", "--")):
            x, y = curve("2021-fig9-readings", "noise_sigma", "mse_factor", estimator=name, sigma_theta_deg=angle,
                         sigma_s_m=0.001)
            axes.loglog(x, y, color=color, linestyle=line, marker=".", label=rf"{STYLE[name][0]}, $\sigma_\theta$ = {angle:g}°")
    x = np.geomspace(0.005, 0.05, 50)
    axes.loglog(x, [known_curve_ratio(distances_2021(2), s) for s in x], color="0.5", linewidth=4, alpha=0.5, label="the true curve")
    axes.axhline(100, color="k", linewidth=0.8)
    axes.axhline(1, color="k", linewidth=0.8, linestyle=":")
    axes.set(xlabel=r"noise: $\beta$ = x $\alpha$", ylabel="MSE ratio (31)")
    axes.set_title(r"L = 2, $\sigma_s$ = 1 mm; 0.05 / $\sqrt{R}$ is the mean of R readings", fontsize=9)
    axes.legend(fontsize=7)
    save(figure, "2021-fig9-readings")


def fig_2021_fig10():
    figure, axes = plt.subplots(2, 4, figsize=(13, 6), layout="constrained")
    names = (("closed-form-paper", "closed form, AIC"), ("closed-form-consistent-bic", "closed form, BIC"),
             ("approximate", "approximate, AIC"), ("marginal", "marginal ML, AIC"))
    for row, noise in enumerate((0.05, 0.01)):
        for panel, (name, title) in zip(axes[row], names):
            x, y, share = table("2021-fig10", "sigma_s_m", "sigma_theta_deg", "order_2", estimator=name, noise_sigma=noise)
            _, _, one = table("2021-fig10", "sigma_s_m", "sigma_theta_deg", lambda r: r["order_0"] + r["order_1"],
                              estimator=name, noise_sigma=noise)
            shade(panel, x, y, share, rf"{title}, $\beta$ = {noise:g} $\alpha$", lambda v: f"{100 * v:.0f}", vmin=0, vmax=1)
            for (j, i), value in np.ndenumerate(one):
                if value > 0.5:
                    panel.text(i, j - 0.33, "n ≤ 1", ha="center", va="center", fontsize=6, color="white")
            panel.set_xlabel(r"$\sigma_s$ [m]")
        axes[row][0].set_ylabel(r"$\sigma_\theta$ [°]")
    figure.suptitle("% of repeats in which order 2, the true one, is selected (L = 2)", fontsize=10)
    save(figure, "2021-fig10")


def fig_2021_fig11():
    sigmas = (0.01, 0.05, 0.1, 0.2)
    figure, axes = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained", sharey=True)
    for panel, sigma in zip(axes, sigmas):
        for name, (label, color, line) in STYLE.items():
            x, y = curve("2021-fig11", "landmarks", "mse_factor", estimator=name, sigma_s_m=sigma)
            if len(x):
                panel.plot(x, y, color=color, linestyle=line, marker=".", label=label)
        panel.set(title=rf"$\sigma_s$ = {100 * sigma:g} cm", xlabel="L")
        panel.set_ylim(bottom=0)
    axes[0].set_ylabel("MSE ratio (31)")
    axes[-1].legend(fontsize=7)
    save(figure, "2021-fig11")


def fig_2021_fig12():
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained", sharey=True)
    names = {"closed-form-paper-thirds": ("closed form, order by thirds", "C1"), "closed-form-paper": ("closed form, order 2", "C3"),
             "marginal": ("marginal ML, order 2", "k")}
    for panel, readings in zip(axes, (1, 10)):
        for shift, (name, (label, color)) in enumerate(names.items()):
            for placement in (1, 2, 3):
                found = rows("2021-fig12", estimator=name, readings=readings, scene=f"scenes/field-{placement}.yaml")
                x = np.array([r["landmarks"] for r in found]) + 0.09 * (3 * shift + placement - 5)
                y = np.array([r["mse_ratio_geometric"] for r in found])
                spread = 10 ** np.array([r["mse_ratio_log10_std"] for r in found])
                panel.errorbar(x, y, yerr=[y - y / spread, y * spread - y], fmt=".", color=color, linewidth=0.8,
                               label=label if placement == 1 else None)
        panel.axhline(10, color="k", linewidth=0.8)
        panel.set(yscale="log", title=f"{readings} reading{'s' if readings > 1 else ''} of each landmark at a stop",
                  xlabel="L; three placements side by side")
    axes[0].set_ylabel("MSE ratio, geometric mean and spread")
    axes[0].legend(fontsize=7, loc="lower right")
    save(figure, "2021-fig12")


def fig_which_landmarks():
    figure, axes = plt.subplots(2, 4, figsize=(13, 5.8), layout="constrained", sharex=True, sharey="row")
    for column, (angle, sigma) in enumerate(((0.5, 0.01), (0.5, 0.05), (2, 0.01), (2, 0.05))):
        for name, (label, color, line) in STYLE.items():
            for row, part in enumerate(("landmark", "curve")):
                x, y = curve("which-landmarks", "stops", f"{part}_rmse_over_bound", estimator=name, sigma_theta_deg=angle,
                             sigma_s_m=sigma)
                if len(x):
                    axes[row][column].semilogx(x, y, color=color, linestyle=line, marker=".", label=label)
        for row in (0, 1):
            axes[row][column].axhline(1, color="0.5", linewidth=4, alpha=0.5)
        axes[0][column].set_title(rf"$\sigma_\theta$ = {angle:g}°, $\sigma_s$ = {100 * sigma:g} cm", fontsize=9)
        axes[1][column].set_xlabel("stops")
    axes[0][0].set_ylabel("landmarks: RMSE / bound")
    axes[1][0].set_ylabel("curve: RMSE / bound")
    axes[0][0].legend(fontsize=7)
    save(figure, "which-landmarks")


def fig_which_pairs():
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", sharey=True)
    for panel, sigma in zip(axes, (0.01, 0.05)):
        for name in ("closed-form", "approximate", "full", "marginal"):
            label, color, line = STYLE[name]
            x, y = curve("which-pairs", "readings", "curve_rmse_over_bound", estimator=name, noise_sigma=sigma)
            panel.semilogx(12 * x, y, color=color, linestyle=line, marker=".", label=label)
        panel.axhline(1, color="0.5", linewidth=4, alpha=0.5)
        panel.set(title=rf"$\sigma_e$ = {sigma:g} /m", xlabel="pairs N")
    axes[0].set_ylabel("curve: RMSE / bound")
    axes[0].legend(fontsize=7)
    save(figure, "which-pairs")


def print_caps():
    """The ratio of the true curve at the paper's noise, by where the distances lie."""
    for landmarks in (1, 2, 5):
        print(f"the first {landmarks} of scenes/2021.yaml: {known_curve_ratio(distances_2021(landmarks), 0.05):.1f}")
    for highest in (4, 5, 6, 8, 10):
        print(f"evenly over 0.2 to {highest} m: {known_curve_ratio(np.linspace(0.2, highest, 2000), 0.05):.1f}")


if __name__ == "__main__":
    if sys.argv[1:] == ["caps"]:
        sys.exit(print_caps())
    drawers = {name[4:].replace("_", "-"): draw for name, draw in globals().items() if name.startswith("fig_")}
    for wanted in sys.argv[1:] or drawers:
        if wanted not in drawers:
            sys.exit(f"draw.py: no figure {wanted}; there are {', '.join(drawers)}")
        drawers[wanted]()
