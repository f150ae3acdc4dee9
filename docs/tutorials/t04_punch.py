"""
Parameters without a covariance: an adaptive high-gain observer
===============================================================

An electromagnetic punch moves a mass by a current. The adaptive high-gain observer estimates its position, its speed
and its parameters with a fixed gain: no covariance is carried, so that it fits on the smallest controller.
"""

# %%
# The machine
# -----------
# Mass, viscous friction and spring, driven by a force that is known. The output is the first state, and the unknown
# parameters enter by products with what is known: the form that the observer needs. Where a model is not in this
# form, ``backsight`` looks for the change of coordinates.

import numpy as np

import backsight as bs
from backsight import plot

machine = bs.Model(
    f=lambda x, u, p: [x.v, p.g * u.F - p.d * x.v - p.c * x.s],
    h=lambda x, u, p: [x.s],
    states={"s": "mm", "v": "mm/s"},
    inputs={"F": "N"},
    outputs={"y": "mm"},
    parameters={"g": (50.0, "mm/s2/N"), "d": (3.0, "1/s"), "c": (400.0, "1/s2")},
)
t = np.arange(0, 4, 1e-3)
force = (
    20.0 * np.sin(2 * np.pi * 1.3 * t)
    + 15.0 * np.sin(2 * np.pi * 3.1 * t)
    + 10.0 * np.sin(2 * np.pi * 7.7 * t)
)
recording = bs.simulate(machine, force[:, None], dt=1e-3, sigma_y=1e-3, seed=3)

# %%
# Gains are proposed from the nominal model and a motion of it
# ------------------------------------------------------------
# ``lambda`` says how fast the observer is, ``Gamma`` how fast every combination of parameters follows. Both need to
# fit the motion; `propose_gain` and `propose_gamma` compute them.

joint = bs.augment(machine, parameters=["g", "d"])
motion = bs.simulate(machine, force[:, None], dt=1e-3)
gain = bs.tune.propose_gain(joint, motion)
Gamma = bs.tune.propose_gamma(joint, motion, gain=gain, rate=5.0)
print(f"gain {gain:.0f} 1/s")

# %%

noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 0.05, "g": 1e-2, "d": 1e-3})
prior = bs.Prior(x0={"g": 40.0, "d": 4.0}, sigma_x0={"s": 0.1, "v": 5.0, "g": 10.0, "d": 1.0})
results = bs.compare(
    {"AHG": bs.AHG(noise, prior, gain=gain, Gamma=Gamma), "EKF": bs.EKF(noise, prior)},
    joint,
    recording,
)
plot.draw_states(results, ["g", "d"])

# %%
# What it costs, and what it lacks
# --------------------------------
# The observer takes a fraction of the time. Its parameters come without bands that the data would have given: who needs
# to know how sure an estimate is takes a filter.

plot.draw_comparison(results)
