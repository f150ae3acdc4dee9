"""
Many recordings at once
=======================

A hundred machines, one model: the recordings go through the lanes of the processor's vectors, several at a time.
"""

# %%
import numpy as np

import backsight as bs
from backsight import plot

rng = np.random.default_rng(0)
plant = bs.sdof(k=40.0, b=0.8, c=1.0)
force = np.sign(np.sin(0.05 * np.arange(1000)))[:, None]
stiffness = 40.0 + 3.0 * rng.normal(size=100)
recordings = [
    bs.simulate(plant, force, dt=0.01, sigma_y=1e-3, seed=i, parameters={"k": k}, substeps=4)
    for i, k in enumerate(stiffness)
]
model = bs.augment(plant, parameters=["k"])
ekf = bs.EKF(
    bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-4}), bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 10.0})
)
results = bs.estimate_many(ekf, model, recordings)
last = [r.isel(time=-1).sel(state="k") for r in results]
found, std = (np.array([float(r[v]) for r in last]) for v in ("x_hat", "x_std"))
print(f"{np.mean(np.abs(found - stiffness) < 3 * std):.0%} of the true values lie in their bands")

# %%
made = plot.figure()
axes = made.axes[0]
machine = np.arange(100)
error = found - stiffness
axes.errorbar(
    machine,
    error,
    3 * std,
    fmt=".",
    color="#0072B2",
    elinewidth=1,
    label="estimate, three standard deviations",
)
plot.truth(axes, machine, 0 * error)
plot.label(axes, "error of the stiffness", "1/s2", x="machine")
plot.legend(axes)
made
