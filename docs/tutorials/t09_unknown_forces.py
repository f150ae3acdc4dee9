"""
Unknown forces, three ways
==========================

A force that nobody measures can be a random walk beside the states, an input of which nothing is assumed, or a few hits. Which
one is right depends on what is known of it; here all three look at the same two recordings.
"""

# %%
# A slow force, and a hit
# -----------------------

import numpy as np

import backsight as bs
from backsight import plot

DT, SIGMA = 1e-3, {"tip": 0.1, "mid": 1e-5}
plain = bs.modal(
    [8.0, 31.0],
    damping=[0.02, 0.02],
    sensors={"tip": ("acceleration", [1.0, -1.0]), "mid": ("displacement", [0.4, 0.8])},
    forces={"F": [1.0, -1.0]},
)
t = DT * np.arange(1200)
slow = 2.0 * np.sin(2 * np.pi * 1.5 * t)
hit = np.where((t >= 0.5) & (t < 0.503), 60.0, 0.0)
known = bs.forces.forces_as_inputs(plain, ["F"])
recordings = {
    name: bs.simulate(known, f[:, None], dt=DT, sigma_y=SIGMA, seed=1).isel(input=[])
    for name, f in {"slow": slow, "hit": hit}.items()
}

# %%
# The three
# ---------

prior = bs.Prior(sigma_x0=1e-4)
noise = bs.Noise(sigma_y=SIGMA)
walking = bs.augment(plain, disturbances={}, parameters=["F"])
methods = {
    "random walk": (
        bs.KalmanFilter(
            bs.Noise(sigma_y=SIGMA, sigma_w={"F": 0.1}),
            bs.Prior(
                sigma_x0={n: (1.0 if n == "F" else 1e-4) for n in [s.name for s in walking.states]}
            ),
        ),
        walking,
    ),
    "joint input": (bs.JointInput(noise, prior, forces=("F",)), plain),
    "sparse": (
        bs.CompressiveSensingMHE(
            noise, prior, forces=("F",), N=20, lam=0.5, sigma_force=0.05, threshold=5.0
        ),
        plain,
    ),
}
found = {
    (name, kind): bs.estimate(method, model, recording)
    for kind, recording in recordings.items()
    for name, (method, model) in methods.items()
}

# %%
# Force over time
# ---------------

made = plot.figure(2)
for axes, (kind, force) in zip(made.axes, {"slow": slow, "hit": hit}.items()):
    for i, name in enumerate(methods):
        result = found[name, kind]
        if "d_hat" in result:
            values = result.d_hat.sel(force="F").values
        else:
            values = result.x_hat.sel(state="F").values
        plot.line(axes, t[: len(values)], values, name=name, series=i)
    plot.truth(axes, t, force)
    plot.label(axes, f"{kind} force", "N")
plot.legend(made.axes[0])
made

# %%
# - The **random walk** is a compromise between following and noise, and its band says how good it is. A whole recording
#   is better smoothed: `smooth`.
# - The **joint input** filter assumes nothing, follows everything, and pays with noise.
# - The **sparse** one is made for hits: nothing where nothing is, and a slow force is what it must not be used for.
