"""
From a Kalman filter to a moving horizon
========================================

One example, changed step by step: what a window of samples adds to a filter, and what it costs.
"""

# %%
# A linear plant: both are the same
# ---------------------------------
# An oscillator whose position is measured. A window over which least squares are solved, with a prior for its
# start that a Kalman filter has carried there, is the Kalman filter: not nearly, exactly.

import numpy as np

import backsight as bs
from backsight import plot

plant = bs.lti(
    [[0, 1], [-30, -0.8]],
    [[0], [2]],
    [[1, 0]],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "N"},
    outputs={"y": "m"},
)
rng = np.random.default_rng(0)
force = np.repeat(rng.normal(size=(60, 1)), 10, axis=0)
recording = bs.simulate(plant, force, dt=0.02, sigma_y=0.01, seed=2)
noise = bs.Noise(sigma_y=0.01, sigma_w={"v": 1e-3})
prior = bs.Prior(sigma_x0=0.3)

kalman = bs.estimate(bs.KalmanFilter(noise, prior), plant, recording)
window = bs.estimate(bs.MHE(noise, prior, N=10), plant, recording)
difference = float(abs(kalman.x_hat - window.x_hat).max())
print(f"largest difference of two estimates: {difference:.1e}")
print(bs.check.certify(bs.MHE(noise, prior, N=10), plant, recording))

# %%
# Noise that has a sign
# ---------------------
# Here something enters the process now and then and never leaves it: a leak, a load, feed on a belt. A Kalman filter
# believes that such noise has mean zero and is always a little behind. A window takes the sign as a limit, at every
# one of its samples.

A = np.array([[0.99, 0.2], [-0.1, 0.3]])
one_sided = np.abs(rng.normal(size=200))
x = np.zeros((200, 2))
for k in range(199):
    x[k + 1] = A @ x[k] + [0.0, one_sided[k]]
mixer = bs.lti(
    A,
    np.zeros((2, 0)),
    [[1, -3]],
    states={"a": "kg", "b": "kg"},
    inputs={},
    outputs={"y": "kg"},
    dt=1.0,
)
y = x @ [1, -3] + 0.1 * rng.normal(size=200)
weighed = bs.from_arrays(y=y[:, None], dt=1.0, inputs={}, outputs={"y": "kg"})
unit = bs.Noise(sigma_y=0.1, sigma_w={"a": 0.0, "b": 1.0})
positive = bs.settings.Limit("feed", {"b": 1.0}, lower=0.0, of="noise")
found = {
    "Kalman filter": bs.estimate(bs.KalmanFilter(unit, prior), mixer, weighed),
    "window, feed >= 0": bs.estimate(
        bs.LinearMHE(unit, prior, N=10, limits=(positive,)), mixer, weighed
    ),
}
for name, result in found.items():
    error = result.x_hat.sel(state="a").values - x[:, 0]
    print(f"{name:18s} rms error of a: {np.sqrt(np.mean(error**2)):.3f} kg")

# %%
made = plot.draw_states(found, ["a"])
plot.truth(made.axes[0], np.arange(200.0), x[:, 0])
made

# %%
# An estimate that comes late
# ---------------------------
# A window also knows what was *behind* each of its samples. Who can wait for a few samples gets a narrower band, down to
# that of the smoother, which has seen everything and is no longer live.

push = 0.1 / 0.02 * rng.normal(size=len(force))
shaken = bs.simulate(
    plant, force, dt=0.02, sigma_y=0.01, disturbances={"v": push}, seed=2, substeps=4
)
rough = bs.Noise(sigma_y=0.01, sigma_w={"v": 0.1})
late = {
    "at once": bs.estimate(bs.MHE(rough, prior, N=20), plant, shaken),
    "5 samples late": bs.estimate(bs.MHE(rough, prior, N=20, lag=5), plant, shaken),
    "15 samples late": bs.estimate(bs.MHE(rough, prior, N=20, lag=15), plant, shaken),
    "smoothed": bs.smooth(bs.KalmanFilter(rough, prior), plant, shaken),
}
for name, result in late.items():
    middle = result.isel(time=slice(100, 500)).sel(state="v")
    error = float(((middle.x_hat - middle.x_true) ** 2).mean() ** 0.5)
    band = float(3 * middle.x_std.mean())
    print(f"{name:16s} band of v +- {band:.4f}, rms error {error:.4f} m/s")

# %%
plot.draw_states(late, ["v"])

# %%
# **Exercise.** Let the noise of the first example be ten times too small in the eyes of the estimator. Which of the four
# errors grows most, and what does ``plot.draw_nis(late)`` say?
