# %% [markdown]
# # 5. From a bag to a corrected bag
#
# A robot drove among pipes, stood still now and then, and recorded its scans and its odometry; nobody measured where the pipes
# are. `RANGECAL_BAG` names the bag (ROS 2: MCAP, SQLite, a rosbag2 folder), `RANGECAL_SCAN` and `RANGECAL_ODOM` its topics,
# `RANGECAL_RADIUS` the pipes' radius in metres, where it is known. Without a bag `stand_in_bag.py` simulates one: twelve
# stops, seven pipes of 20 cm, and something that no calibration is told.
#
# What looks like a cylinder in the scans of a stand becomes a range and a bearing; what recurs at the same place is a landmark. Odometry
# says where the robot stood, to a centimetre or half of one.

# %%
import os
import tempfile
from pathlib import Path

import numpy as np

import rangecal

folder = Path(tempfile.mkdtemp())
own = os.environ.get("RANGECAL_BAG")
bag = Path(own or folder / "run.mcap")
if not own:
    import stand_in_bag
    stand_in_bag.write(bag, seed=7)
radius = os.environ.get("RANGECAL_RADIUS", "" if own else stand_in_bag.RADIUS)
options = {"topic": os.environ.get("RANGECAL_SCAN", "/scan"), "odometry_topic": os.environ.get("RANGECAL_ODOM", "/odom"),
           "radius_m": float(radius) if radius else None, "sigma_xy_m": 0.01 if own else 0.005}
print(f"{bag.name}: {bag.stat().st_size / 1e6:.1f} MB")

extraction = rangecal.extract(bag, **options)
print(extraction.text)
recording = extraction.recording
recording.plot();

# %% [markdown]
# ## Readings to a curve, and what the curve leaves

# %%
calibration = rangecal.calibrate(recording)
calibration.plot()
diagnosis = rangecal.diagnose(recording)
print(diagnosis.sentence)
print(diagnosis.to_frame()[["parameter", "estimate", "std"]].round(4).head(3).to_string())

# %% [markdown]
# ## The bag once more, with distances in place of readings
#
# What the diagnosis leaves without a name is the extraction's: a pipe that more beams hit has a better bearing. The completed model undoes
# the curve and the effect that it names, beam by beam. All other messages are copied byte for byte.

# %%
corrected = folder / f"corrected{bag.suffix}"
done = rangecal.correct_bag(diagnosis.corrected, bag, corrected, topic=options["topic"], keep_raw="/scan_raw")
print(f"{done.topic}: {done.readings} readings, {done.corrected} corrected, {done.kept} without a return, "
      f"{done.without_distance} without a distance")

# %% [markdown]
# ## Is it better?
#
# The same pipes, extracted from the corrected bag and calibrated once more: of a perfect sensor the curve is the distance itself.

# %%
again = rangecal.extract(corrected, **options).recording
calibrated = rangecal.calibrate(again)
for name, one in (("raw", calibration), ("corrected", calibrated)):
    off = one.f(np.array([0.5, 1.0, 2.0, 3.0])) - [0.5, 1.0, 2.0, 3.0]
    print(f"{name:10} reading less distance at 0.5, 1, 2, 3 m [mm]: " + ", ".join(f"{1e3 * v:+.1f}" for v in off))

# %% [markdown]
# ## What must hold

# %%
if not own:
    assert len(recording.landmark_labels) == len(stand_in_bag.PIPES) and len(recording.stop_labels) == len(stand_in_bag.STOPS)
    assert "warmup_drift" in diagnosis.final_effects
    found = {e.name: e for e in diagnosis.explanations[0].parameters}["warmup_drift.time_s"]
    assert abs(found.estimate - stand_in_bag.AFTER) < 4 * found.std
    assert done.corrected > 20_000 and done.without_distance < 100
    assert np.max(np.abs(off)) < 0.005
