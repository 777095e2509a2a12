# %% [markdown]
# # 4. Plan the next experiment
#
# A recording can be free of any mismatch and still hide one: where the calibration's own unknowns take an effect up, no
# reading shows it. `diagnose` says what could hide, what it would cost, and what to record next. Here that advice is
# taken.

# %%
import numpy as np
from matplotlib import pyplot

import rangecal

scene = {
    "sensor": {"name": "planned", "principle": "triangulation", "alpha": [0.0525, 0.8838, 0.0584],
               "noise": {"law": "f2", "sigma": 0.01}, "sigma_theta_rad": 0.0087,
               "range_min_m": 0.1, "range_max_m": 10.0},
    "stops": {"line": {"count": 10, "step_m": 0.3}, "sigma_xy_m": 0.01},
    "landmarks": {"radius_m": 0.12, "list": [
        {"landmark": label, "x_m": x, "y_m": y} for label, x, y in
        [("A", 0.42, 0.71), ("B", 1.63, -0.52), ("C", 2.28, 1.66), ("D", 0.87, -2.35), ("E", 2.55, 4.10)]]},
    "repeats": 10,
}
tilt = {"tilt": {"cosine_rad2": 0.0076, "sine_rad2": 0.0076}}   # its typical size: about 6 degrees
straight = rangecal.simulate(scene, 2, effects=tilt)
straight.plot();

# %% [markdown]
# ## A clean bill, and its small print
#
# The sensor was mounted askew, and nobody knows. The robot always looked ahead.

# %%
first = rangecal.diagnose(straight)
print(first.sentence)
unseen = first.to_frame("unseen")
unseen["harm_mm"] = (1e3 * unseen["harm_m"]).round(1)
print(unseen[["effect", "harm_mm", "settled_by"]].head(9).to_string(index=False))

# %% [markdown]
# Tilt is in the list: it could be there at its typical size and would not show (`detectable` is the size that would).
# What to do about as much of the list as possible, most first; `power` is computed for this very recording extended by the
# change:

# %%
plans = first.to_frame("next_experiments")
plans["power"] = plans["power"].round(1)
print(plans[["change", "power"]].head(4).to_string(index=False))

# %% [markdown]
# ## Do it: turn the sensor at each stop
#
# Four headings at every place; stops of one place share their position error, since the robot did not move.

# %%
headings = dict(zip("abcd", (0.0, np.pi / 2, np.pi, -np.pi / 2)))
turning_scene = {**scene, "stops": {"sigma_xy_m": 0.01, "list": [
    {"stop": f"{k}{name}", "x_m": 0.3 * k, "y_m": 0.0, "heading_rad": heading, "place": str(k)}
    for k in range(10) for name, heading in headings.items()]}}
turning = rangecal.simulate(turning_scene, 2, effects=tilt)
second = rangecal.diagnose(turning)
print(second.sentence)
print(second.to_frame()[["parameter", "estimate", "std"]].round(3).to_string(index=False))

# %%
figure, axes = pyplot.subplots(1, 3, figsize=(10, 2.8), layout="constrained", sharey=True)
for ax, title, recording, calibration in ((axes[0], "straight", straight, first.baseline),
                                          (axes[1], "turning", turning, second.baseline),
                                          (axes[2], "turning, tilt in the model", turning, second.corrected)):
    rangecal.residuals(recording, calibration, along=["sensor_bearing"]).plot("sensor_bearing", "bearing", ax=ax)
    ax.set_title(title, fontsize="small")

# %% [markdown]
# ## Was the plan good, or the draw lucky?

# %%
quick = {"held_out": False, "unseen": False, "next_experiments": False}
named = {"straight": 0, "turning": 0}
for seed in range(10):
    for design, layout in (("straight", scene), ("turning", turning_scene)):
        found = rangecal.diagnose(rangecal.simulate(layout, 100 + seed, effects=tilt), **quick)
        named[design] += found.final_effects == ["tilt"]
print(named, "of 10")

# %% [markdown]
# ## What no turning settles
#
# If the robot's odometry is 1 % short, landmarks and curve stretch with it, and every reading fits: `odometry_scale` is a
# twin of `alpha_1`. A tape between two landmarks fixes the scale. The diagnosis stays silent, since nothing contradicts
# the model any more than before; the curve is what gets better.

# %%
print([twins for twins in first.twins if "odometry_scale" in twins])
d = np.linspace(0.5, 4.0, 8)
truth = np.polyval([0.0584, 0.8838, 0.0525], d)


def curve_error_mm(tapes, seed):
    recording = rangecal.simulate({**scene, "known_distances": tapes}, seed,
                                  effects={"odometry_scale": {"scale": 0.01}})
    calibration = rangecal.calibrate(recording, order=2, noise="f2")
    return 1e3 * np.sqrt(np.mean((calibration.f(d) - truth) ** 2))


tapes = [{"from": "A", "to": "E", "sigma_m": 0.002}, {"from": "B", "to": "D", "sigma_m": 0.002}]
without, taped = (np.sqrt(np.mean([curve_error_mm(t, seed) ** 2 for seed in range(20)])) for t in ([], tapes))
print(f"RMS error of f over 20 recordings: {without:.0f} mm; with two taped distances {taped:.0f} mm")

# %% [markdown]
# ## What must hold

# %%
assert first.verdict == "no_mismatch" and "tilt" in set(unseen["effect"])
assert unseen.set_index("effect")["detectable"].astype(float)["tilt"] > 2 * 0.0076   # far above its typical size
assert any("turn the sensor" in change for change in plans["change"])
assert second.final_effects == ["tilt"]
angle = next(p for p in second.explanations[0].parameters if p.name == "tilt.angle_rad")
assert abs(angle.estimate - np.sqrt(np.hypot(0.0076, 0.0076))) < 4 * angle.std
assert named["straight"] <= 2 and named["turning"] >= 8   # 8 or more of 10: power above 0.45 with 99 % confidence
assert taped < 0.6 * without
