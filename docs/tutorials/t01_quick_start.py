"""
Quick start: from a CSV file to a mass with a band
==================================================

A cart is pushed by a measured force; an encoder says where it is. How heavy is it, how much does its
bearing brake, and is the answer to be believed? Five steps, and none needs a formula.
"""

# %%
# Your file
# ---------
# Any text of a logger will do; here we write one first, with decimal points, a line of units, and one
# sample lost. (The true cart has 12.5 kg and 8 N s/m. No estimator is told so.)

import tempfile
from pathlib import Path

import numpy as np

import backsight as bs
from backsight import plot

cart = bs.from_equations(
    states={"x": "m", "v": "m/s"},
    inputs={"F": "N"},
    outputs={"pos": "m"},
    parameters={"m": (12.5, "kg"), "c": (8.0, "N s/m")},
    equations={"x": "v", "v": "(F - c*v) / m"},
    output_equations={"pos": "x"},
)
push = 20.0 * np.sign(np.sin(2.0 * np.arange(0, 10, 0.01)))[:, None]
made = bs.simulate(cart, push, dt=0.01, sigma_y=1e-3, seed=1)
lines = [
    f"{t:.2f},{f:.1f},{y:.4f}" for t, f, y in zip(made.time.values, push[:, 0], made.y.values[:, 0])
]
lines[500] = lines[500].rpartition(",")[0] + ","
file = Path(tempfile.mkdtemp(), "cart.csv")
file.write_text("time,force,position\ns,N,m\n" + "\n".join(lines) + "\n", encoding="utf-8")
print(file.read_text()[:80])

# %%
# Read it
# -------
# Say which column is what. Times, units, gaps are found and checked; the recording says how it was read.

recording = bs.read(file, time="time", inputs={"F": "force"}, outputs={"pos": "position"})
print(recording.attrs["understood"])
print(
    f"{recording.sizes['time']} samples every {recording.attrs['dt']} s,",
    f"{int(recording.y.isnull().sum())} missing",
)

# %%
# Say what you know
# -----------------
# The equations, by Newton, and a guess of what is unknown: the mass may be 10 kg give or take 5.
# ``augment`` makes unknown constants states, so that every estimator finds them.

guess = bs.from_equations(
    states={"x": "m", "v": "m/s"},
    inputs={"F": "N"},
    outputs={"pos": "m"},
    parameters={"m": (10.0, "kg"), "c": (5.0, "N s/m")},
    equations={"x": "v", "v": "(F - c*v) / m"},
    output_equations={"pos": "x"},
)
model = bs.augment(guess, parameters=["m", "c"])
prior = bs.Prior(sigma_x0={"x": 0.01, "v": 0.1, "m": 5.0, "c": 5.0})
noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-4})

# %%
# Run
# ---
# The extended Kalman filter is always the first to try.

result = bs.estimate(bs.EKF(noise, prior), model, recording)
for name in ("m", "c"):
    last = result.sel(state=name).isel(time=-1)
    print(f"{name} = {float(last.x_hat):.3f} +- {float(last.x_std):.3f} {last.state_unit.item()}")

# %%
# Look, and ask whether to believe it
# -----------------------------------
# Bands are three standard deviations. The mass is known within a second; the force changes its sign
# and moves the cart each time, and that is what tells mass from friction.

plot.draw_states(result, ["m", "c"], reference={"m": 12.5, "c": 8.0})

# %%
# The verdict compares what the filter predicts with what came in. It needs no truth.

comparison = bs.compare({"EKF": bs.EKF(noise, prior)}, model, recording)
for sentence in comparison.verdicts():
    print(sentence)

# %%
# The interactive page for a colleague is one line: ``bs.report(comparison, "report.html")``. The same in a
# file that needs no Python is a problem file; see `examples/stage/problem.toml` and
# ``backsight run problem.toml --out out``.
