"""
Mass and friction of a drive
============================

A drive with viscous and Coulomb friction, its force and its encoder. Which parameters can be told depends on the
motion: a drive that never stops does not show its Coulomb friction apart from a constant force.
"""

# %%
import numpy as np

import backsight as bs
from backsight import plot

drive = bs.Model(
    f=lambda x, u, p: [x.v, (u.F - p.Fv * x.v - p.Fc * np.tanh(x.v / 5e-3) - p.off) / p.M],
    h=lambda x, u, p: [x.q],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "N"},
    outputs={"y": "m"},
    parameters={"M": (95.0, "kg"), "Fv": (210.0, "N s/m"), "Fc": (20.0, "N"), "off": (-3.0, "N")},
)
t = np.arange(0, 6, 2e-3)
force = 45.0 * np.sign(np.sin(2 * np.pi * 0.5 * t)) + 25.0 * np.sin(2 * np.pi * 2.3 * t)
recording = bs.simulate(drive, force[:, None], dt=2e-3, sigma_y=1e-5, seed=1)

# %%
# Before the run: can it be told?
# -------------------------------
# The expected bands of all four, from the model and the motion alone. The motion changes its sign, so all are seen.

unknown = ["M", "Fv", "Fc", "off"]
joint = bs.augment(drive, parameters=unknown)
noise = bs.Noise(sigma_y=1e-5, sigma_w={"v": 1e-5})
prior = bs.Prior(
    x0={"M": 70.0, "Fv": 150.0, "Fc": 10.0, "off": 0.0},
    sigma_x0={"q": 1e-3, "v": 1e-2, "M": 30.0, "Fv": 80.0, "Fc": 15.0, "off": 5.0},
)
print(bs.check.check_identifiability(bs.EKF(noise, prior), joint, recording))

# %%
# Run a filter and a window
# -------------------------

results = bs.compare(
    {"EKF": bs.EKF(noise, prior), "MHE": bs.MHE(noise, prior, N=30)}, joint, recording
)
print(results.table({"M": 95.0, "Fv": 210.0, "Fc": 20.0, "off": -3.0}))

# %%
plot.draw_states(results, unknown, reference={"M": 95.0, "Fv": 210.0, "Fc": 20.0, "off": -3.0})

# %%
# **Exercise.** Let the drive run in one direction only (``force = 200 + ...``). Whose band stays wide, and what does
# the sum of which two become well known?
