# %% [markdown]
# # 3. Diagnose a concealed effect, step by step
#
# `concealed/world-04` was made by a physical simulator with something in it that the calibration's model does not know.
# What it is lies sealed in `concealed-keys`. First by eye, residual by residual; then by `diagnose`; then the key.

# %%
import hashlib
import json
from pathlib import Path

import numpy as np
from matplotlib import pyplot

import rangecal

recording = rangecal.load("concealed/world-04")
recording

# %% [markdown]
# ## The seed model, and what it leaves

# %%
seed = rangecal.calibrate(recording)
covariates = ["sensor_bearing", "disparity", "time", "temperature_c", "intensity"]
left = rangecal.residuals(recording, seed, along=covariates)
range_chi_sq = np.mean((left.range_residual_m / left.range_std_m) ** 2)
bearing_chi_sq = np.mean((left.bearing_residual_rad / left.bearing_std_rad) ** 2)
print(f"order {seed.order}, noise {seed.noise_law}, sigma_theta {np.degrees(seed.sigma_theta_rad):.2f} deg")
print(f"mean square of residual / spread: range {range_chi_sq:.2f}, bearing {bearing_chi_sq:.2f}")

# %% [markdown]
# Both near one: the sigmas were fitted to these very residuals, so their size tells nothing. Their order does. Range
# residuals over three covariates (grey: readings; blue: means of bins with their 95 % interval):

# %%
figure, axes = pyplot.subplots(1, 3, figsize=(10, 2.6), layout="constrained", sharey=True)
for ax, along in zip(axes, ["range", "sensor_bearing", "time"]):
    left.plot(along, "range", ax=ax)

# %% [markdown]
# Flat. Bearing residuals over four:

# %%
figure, axes = pyplot.subplots(1, 4, figsize=(11, 2.6), layout="constrained", sharey=True)
for ax, along in zip(axes, ["disparity", "sensor_bearing", "time", "temperature_c"]):
    left.plot(along, "bearing", ax=ax)

# %% [markdown]
# Along the first, 1/d, they climb: near landmarks appear turned against far ones. A number for it, with one mean per
# (stop, landmark), since repeats of a cell share whatever is wrong there:

# %%
frame = left.to_frame().groupby(["stop", "landmark"]).mean()
correlations = {name: np.corrcoef(frame[name], frame["bearing_residual_rad"])[0, 1] for name in covariates}
for name, value in correlations.items():
    print(f"{name:15} {value:+.2f}")

# %% [markdown]
# A beam that passes beside the spin axis at an offset b misses its direction by about b/d. That would be a straight line
# through 1/d; its slope is b, less what the landmarks took up by giving way (the catalogue counts b to the other side):

# %%
slope = np.polyfit(frame["disparity"], frame["bearing_residual_rad"], 1)[0]
print(f"slope {1e3 * slope:.1f} mm")

# %% [markdown]
# ## The tool
#
# It asks every such question at once, with one false-alarm rate for all of them, then tries what physics it knows.

# %%
diagnosis = rangecal.diagnose(recording)
print(diagnosis.sentence)
location = diagnosis.to_frame("location")[["channel", "covariate", "shape"]]
print(location.head(3).to_string())

# %%
diagnosis.plot();

# %%
print(diagnosis.to_frame().round(4).to_string())
print(diagnosis.to_frame("fit").loc[["heldout_nll", "rms_range_m", "rms_bearing_rad", "chi_sq_per_dof"]]
      .to_string(float_format="{:.4g}".format))

# %% [markdown]
# The held-out density improves: that is not a fit to noise. What is left now:

# %%
after = rangecal.residuals(recording, diagnosis.corrected, along=["disparity"])
after.plot("disparity", "bearing");

# %% [markdown]
# ## The key
#
# `commitment.txt` is the SHA-256 of the key, published with the recording: it was not changed afterwards.

# %%
key_file = Path("concealed-keys/world-04.json")
committed = Path("concealed/world-04/commitment.txt").read_text().split()[0]
key = json.loads(key_file.read_text())
print(key["planted"], {name: round(value, 4) for name, value in key["truth"].items()})

# %% [markdown]
# ## What must hold

# %%
assert hashlib.sha256(key_file.read_bytes()).hexdigest() == committed
assert diagnosis.verdict == "explained" and diagnosis.final_effects == key["planted"] == ["beam_offset"]
for estimate in diagnosis.explanations[0].parameters:
    assert abs(estimate.estimate - key["truth"][estimate.name]) < 3 * estimate.std, estimate.name
assert max(correlations, key=lambda name: abs(correlations[name])) == "disparity"
assert diagnosis.before.heldout_nll - diagnosis.after.heldout_nll > 50
