"""
Tune the noise
==============

How noisy is the sensor, how hard does the world push? Nobody knows, and the bands are as right as these two numbers. They are
in the recording: the filter predicts every measurement before it sees it, and right numbers predict best.
"""

# %%
# A recording, and two wrong guesses
# ----------------------------------
# A mass on a spring is pushed by gusts (0.02 m/s from sample to sample). Its sensor has 1 mm of noise. We guess ten times too
# much of the one and twenty times too little of the other.

import numpy as np

import backsight as bs
from backsight import plot

plant = bs.lti(
    [[0, 1], [-40, -0.8]],
    [[0, 0], [1, 1]],
    [[1, 0]],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "m/s2", "gust": "m/s2"},
    outputs={"y": "m"},
)
t = 0.02 * np.arange(1500)
gusts = np.random.default_rng(1).normal(0.0, 0.02 / 0.02, len(t))
both = np.column_stack([np.sign(np.sin(t)), gusts])
recording = bs.simulate(plant, both, dt=0.02, sigma_y=1e-3, seed=2).sel(input=["F"])
model = bs.lti(
    [[0, 1], [-40, -0.8]],
    [[0], [1]],
    [[1, 0]],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "m/s2"},
    outputs={"y": "m"},
)
prior = bs.Prior(sigma_x0={"q": 0.1, "v": 0.5})
guess = bs.KalmanFilter(bs.Noise(sigma_y=1e-2, sigma_w={"v": 1e-3}), prior)
before = bs.estimate(guess, model, recording)
print(bs.check.check_consistency(before))

# %%
# Tune
# ----
# ``free`` names what shall be found. The rest stays as it is.

tuned = bs.tune.fit(guess, model, recording, free=["sigma_y", "sigma_w.v"], restarts=0)
print(tuned)

# %%
# Both within a few percent of the truth, and the line says how sure it is. The estimator that comes back is ready to use.

after = bs.estimate(tuned.estimator, model, recording)
plot.draw_nis({"guess": before, "tuned": after})

# %%
# The speed, which no sensor sees: with the guess the filter trusts its model and misses the gusts, and its band does not say so.

part = {"guess": before.isel(time=slice(300, 500)), "tuned": after.isel(time=slice(300, 500))}
plot.draw_states(part, ["v"])

# %%
# Is it sharp?
# ------------
# By how much the criterion rises along each value, with everything else found anew: a sharp valley is knowledge, a flat one is
# not. Where it crosses the dotted line are the ends of a 95 % interval.

made = plot.figure(1, 2)
for axes, name in zip(made.axes, tuned.profiles["name"].values, strict=True):
    valley = tuned.profiles.sel(name=name).sortby("value")
    plot.line(axes, valley["value"].values, valley["rise"].values, name=str(name), series=0)
    axes.axhline(1.92, color="#656d76", linewidth=1, linestyle=":")
    plot.label(axes, f"rise of the criterion over {name}", x="value")
made

# %%
# **Exercise.** Use only the first 100 samples. By how much do the ± grow, and do the values still lie within?
