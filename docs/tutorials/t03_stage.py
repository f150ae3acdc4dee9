"""
Stiffness of a stage that loses its payload
===========================================

A nanopositioning stage is driven by a random voltage. After 0.2 s its payload is taken off: stiffness, damping and
gain per unit of mass jump. A moving horizon observer and an extended Kalman filter follow them, sample by sample.
"""

# %%
# The model, with what is unknown as states
# -----------------------------------------
# One mode of vibration, everything per unit of mass. Three parameters and a force that nobody measures join the
# position and the speed: six states, one sensor.

import backsight as bs
from backsight import plot

stage = bs.Model(
    f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
    h=lambda x, u, p: [x.q],
    states={"q": "um", "v": "um/s"},
    inputs={"V": "V"},
    outputs={"y": "um"},
    parameters={"k": (7.06e6, "1/s2"), "b": (77.0, "1/s"), "c": (5.4e5, "um/s2/V")},
)
DT, SIGMA = 1e-4, 1e-3
voltage = bs.signals.prbs(4000, seed=1, samples_per_bit=4)[:, None]
recording = bs.simulate(
    stage,
    voltage,
    dt=DT,
    sigma_y=SIGMA,
    seed=2,
    changes={0.2: {"k": 9.2e6, "b": 88.0, "c": 7.0e5}},
)
joint = bs.augment(stage, parameters=["k", "b", "c"], disturbances={"w": "v"})
print(joint)

# %%
# Two estimators, one noise
# -------------------------
# The walks of the parameters say how fast they may change per sample: this is the price of being able to follow.

noise = bs.Noise(sigma_y=SIGMA, sigma_w={"v": 1.0, "k": 2e4, "b": 0.2, "c": 2e3, "w": 10.0})
prior = bs.Prior(
    x0={"k": 6e6, "b": 70.0, "c": 5e5},
    sigma_x0={"q": 1.0, "v": 1e3, "k": 1e6, "b": 5.0, "c": 1e5, "w": 1.0},
)
steps = bs.Integrator("heun", substeps=8)
results = bs.compare(
    {
        "EKF": bs.EKF(noise, prior, integrator=steps),
        "MHO": bs.MHO(noise, prior, N=15, alpha=1e-2, integrator=steps),
    },
    joint,
    recording,
)
print(results)

# %%
# What they see
# -------------
# Dashed is the truth. Both find the new stiffness within some 20 ms; the window sees the change as a whole.

plot.draw_states(results, ["k", "b", "c", "w"])

# %%
# Is it to be believed?
# ---------------------
# The mean of the normalised innovations squared says how large the surprises are against what was predicted: 1 per
# output is right. At the jump they must be large, for no walk foretells it.

plot.draw_nis(results)

# %%
# The verdict sees it, too: between the jumps nothing walks, so that the process noise that lets the estimators follow is
# too large for most of the recording. That is the price of following, and it is paid in wider bands.

for sentence in results.verdicts():
    print(sentence)
