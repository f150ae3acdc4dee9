"""
Live: a sample comes, an estimate goes
======================================

The same estimator that went over a recording takes one sample at a time, in microseconds, and gives the same numbers to
the last bit.
"""

# %%
import time

import numpy as np

import backsight as bs
from backsight import plot

model = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k"])
force = np.sign(np.sin(0.05 * np.arange(2000)))[:, None]
recording = bs.simulate(
    bs.sdof(k=40.0, b=0.8, c=1.0), force, dt=0.01, sigma_y=1e-3, seed=1, changes={10.0: {"k": 30.0}}
)
ekf = bs.EKF(
    bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3, "k": 0.05}),
    bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 5.0}),
)

# %%
# The loop of your machine
# ------------------------

live = bs.stream(ekf, model, dt=0.01)
shown, spent = [], []
for u, y in zip(recording.u.values, recording.y.values):
    begin = time.perf_counter()
    sample = live.step(u, y)
    spent.append(time.perf_counter() - begin)
    shown.append(sample)
print(sample)

# %%
# Nothing differs from the run over the recording:

whole = bs.estimate(ekf, model, recording)
print(float(abs(np.array([s["x_hat"] for s in shown]) - whole.x_hat.values).max()))

# %%
plot.draw_states(whole, ["k"])
