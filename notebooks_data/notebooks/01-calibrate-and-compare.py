# %% [markdown]
# # 1. Calibrate and compare
#
# A cheap range sensor reports `y = f(d) + s(d) e` instead of the true distance `d`. A robot drove past five cylinders at
# unknown places, stopped ten times, and read range and bearing of each ten times. From that alone `rangecal` finds f,
# the noise, and where everything stood. The recording is simulated (`field-layout/README.md`), so the truth is known.

# %%
import numpy as np
import rangecal

recording = rangecal.load("field-layout")
recording

# %% [markdown]
# Readings as the sensor gave them, from where the robot was told to stand; crosses are the true landmarks. Far landmarks
# smear: that is noise, and f.

# %%
recording.plot();

# %% [markdown]
# ## Calibrate
#
# Order of f and noise law are chosen by AIC. `marginal` integrates the uncertain stops out.

# %%
calibration = rangecal.calibrate(recording)
calibration

# %%
print(calibration.models_to_frame().head(4).round(1).to_string())

# %% [markdown]
# f(d) - d is what the sensor adds to a distance: the band is the 95 % interval of f, the pale one the spread of a
# reading.

# %%
ax = calibration.plot()
d = np.linspace(*calibration.range_m, 100)
truth = np.polyval([0.0584, 0.8838, 0.0525], d)   # of the scene, scenes/field-layout.yaml
ax.plot(d, 1e3 * (truth - d), "k--", linewidth=1.0, label="truth")
ax.legend();

# %% [markdown]
# ## Is it right?
#
# Errors against their own covariance: chi^2 is about its degrees of freedom where the covariance is honest, and far
# above where it is not.

# %%
error = calibration.alpha - np.array([0.0525, 0.8838, 0.0584])
curve_chi_sq = error @ np.linalg.solve(calibration.covariance, error)
places = calibration.landmarks - recording.true_landmarks
landmark_chi_sq = [e @ np.linalg.solve(c, e) for e, c in zip(places, calibration.landmark_covariance)]
print(f"curve: chi^2 = {curve_chi_sq:.2f} with 3 degrees of freedom")
print(f"landmarks: off by {1e3 * np.sqrt(np.mean(np.sum(places**2, axis=1))):.1f} mm RMS, "
      f"chi^2 = {sum(landmark_chi_sq):.2f} with 10")

# %% [markdown]
# ## Four methods side by side
#
# `closed-form` and `approximate` take the commanded stops for true; `full` fits every stop to the readings; `marginal`
# integrates them out. All are scored by the same likelihoods and against the truth.

# %%
comparison = rangecal.compare(recording)
rows = ["outcome", "sigma_theta", "marginal NLL", "AIC", "landmark RMSE [m]", "range RMSE raw [m]",
        "range RMSE corrected [m]", "MSE ratio"]
print(comparison.to_frame().loc[rows].to_string(float_format="{:.4g}".format))

# %%
comparison.plot();

# %% [markdown]
# ## Use it

# %%
corrected = rangecal.correct(calibration, [0.5, 1.234, 2.5, 4.5])
print(corrected.to_frame().round(4).to_string())

# %% [markdown]
# ## What must hold

# %%
assert calibration.outcome == "converged" and (calibration.order, calibration.noise_law) == (2, "f2")
assert curve_chi_sq < 16.3         # 99.9 % of chi^2 with 3 degrees of freedom
assert sum(landmark_chi_sq) < 29.6   # the same with 10
scores = {c.method: s for c, s in zip(comparison.calibrations, comparison.scores)}
assert min(s.mse_ratio for s in scores.values()) > 10            # every method gains tenfold, as the 2021 paper found
assert scores["marginal"].landmark_rmse_m < scores["closed-form"].landmark_rmse_m
assert comparison["full"].sigma_theta_rad < comparison["marginal"].sigma_theta_rad   # full gives honest sigmas away
assert list(corrected.flag) == ["ok"] * 4
