"""
Least squares over a window: batch, recursive, two rates
========================================================

For a linear model the moving horizon estimator is linear least squares. It is solved for a window at once, or
recursively, and it takes sensors of different rates without a trick: what was not measured has no row.
"""

# %%
# A drive with a fast encoder and a slow laser
# --------------------------------------------
# The encoder counts at every sample and is coarse; the laser is ten times better and comes every twentieth.

import numpy as np

import backsight as bs
from backsight import plot

drive = bs.lti(
    [[0, 1], [0, -2]],
    [[0], [3]],
    [[1, 0], [1, 0]],
    states={"x": "mm", "v": "mm/s"},
    inputs={"u": "V"},
    outputs={"encoder": "mm", "laser": "mm"},
)
rng = np.random.default_rng(3)
u = np.repeat(rng.normal(size=(40, 1)), 20, axis=0)
recording = bs.simulate(drive, u, dt=0.01, sigma_y={"encoder": 0.02, "laser": 0.002}, seed=1)
seldom = np.arange(len(u)) % 20 != 0
recording["y"].loc[{"output": "laser"}] = np.where(seldom, np.nan, recording.y.sel(output="laser"))
print(recording.y.notnull().sum("time").to_series())

# %%
# Three ways to the same estimate
# -------------------------------

noise = bs.Noise(sigma_y={"encoder": 0.02, "laser": 0.002}, sigma_w={"v": 0.01})
prior = bs.Prior(sigma_x0={"x": 0.1, "v": 0.5})
results = bs.compare(
    {
        "Kalman filter": bs.KalmanFilter(noise, prior),
        "window of 20": bs.LinearMHE(noise, prior, N=20),
        "recursive, every 4": bs.RecursiveMHE(noise, prior, N=20, every=4),
    },
    drive,
    recording,
)
print(results)

# %%
plot.draw_states(results, ["v"])

# %%
# The saw teeth of the band are the laser: every twentieth sample the position is known again.

late = recording.isel(time=slice(300, 420))
window = results["window of 20"].isel(time=slice(300, 420))
plot.draw_states({"window of 20": window}, ["x"])

# %%
# **Exercise.** Take the laser out altogether (all NaN). Which state suffers, and by how much?
