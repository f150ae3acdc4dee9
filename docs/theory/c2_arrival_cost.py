"""
Arrival cost
============

A window forgets. What the samples before it said must be handed on in one term, and this term decides whether the estimator is
right, wasteful, or too sure of itself. :doc:`The page on arrival costs </arrival-cost>` has the theory and a study; here a window of
three lines shows it.
"""

# %%
# One constant, measured again and again
# --------------------------------------
# The smallest moving horizon estimator: a number x, measurements :math:`y_k = x + v_k` of variance R, a window of N + 1 samples. The
# prior of its first sample has mean m and information (inverse variance) J; the estimate is the weighted mean of all. When the
# window moves, what is the next prior?
#
# - *nothing*: :math:`J = 0`,
# - *naive*: the estimate and information of the whole window; but N of its samples are in the next window, too,
# - *right*: the information of the prior and of the one sample that leaves.

import numpy as np

import backsight as bs
from backsight import plot

R, N, SAMPLES, RUNS = 1.0, 10, 200, 400
y = np.random.default_rng(0).normal(0.0, np.sqrt(R), (RUNS, SAMPLES))  # the truth is 0


def window(rule):
    """Estimates (runs, samples) and the standard deviation that is claimed."""
    m, J = np.zeros(RUNS), 1e-4
    estimates, claimed = np.empty((RUNS, SAMPLES)), np.empty(SAMPLES)
    for k in range(SAMPLES):
        start = max(k - N, 0)
        inside = y[:, start : k + 1]
        information = J + inside.shape[1] / R
        estimates[:, k] = (J * m + inside.sum(axis=1) / R) / information
        claimed[k] = information**-0.5
        if k < N:
            continue
        if rule == "nothing":
            m, J = np.zeros(RUNS), 0.0
        elif rule == "naive":
            m, J = estimates[:, k], information
        else:
            m, J = (J * m + y[:, start] / R) / (J + 1.0 / R), J + 1.0 / R
    return estimates, claimed


made = plot.figure(1, 2, height=2.6)
for i, rule in enumerate(("nothing", "naive", "right")):
    estimates, claimed = window(rule)
    plot.line(made.axes[0], np.arange(SAMPLES), estimates.std(axis=0), name=rule, series=i)
    plot.line(
        made.axes[1], np.arange(SAMPLES), estimates.std(axis=0) / claimed, name=rule, series=i
    )
for axes in made.axes:
    axes.set_yscale("log")
plot.label(made.axes[0], "error", x="sample")
plot.label(made.axes[1], "error by what is claimed", "1", x="sample")
plot.legend(made.axes[1])
made

# %%
# Without an arrival cost the error stays that of eleven samples for ever. The naive one is as exact as the right one and claims
# :math:`\sqrt{N + 1} = 3.3` times too much: every sample counts eleven times. That is the mistake that is made most often, and
# with process noise it hides.

# %%
# The same in an estimator
# ------------------------
# A spring whose stiffness is unknown: here the arrival cost has five choices, and what they claim can be compared with what they
# achieve, over 12 recordings.

joint = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k"])
push = np.sign(np.sin(0.07 * np.arange(160)))[:, None]
recordings = [
    bs.simulate(bs.sdof(k=43.0, b=0.8, c=1.0), push, dt=0.05, sigma_y=2e-3, seed=i)
    for i in range(12)
]
noise = bs.Noise(sigma_y=2e-3, sigma_w={"v": 1e-5})
prior = bs.Prior(sigma_x0={"q": 0.01, "v": 0.01, "k": 5.0})
costs = {
    "nothing": bs.settings.NoArrival(),
    "naive": bs.settings.SmoothedArrival(naive=True),
    "smoothed": bs.settings.SmoothedArrival(),
}
for name, cost in costs.items():
    results = bs.estimate_many(bs.MHE(noise, prior, N=10, arrival=cost), joint, recordings)
    last = [r.sel(state="k").isel(time=-1) for r in results]
    error = np.array([float(r.x_hat) - 43.0 for r in last])
    std = np.array([float(r.x_std) for r in last])
    print(
        f"{name:9} error {np.sqrt(np.mean(error**2)):6.3f}   claimed {np.median(std):6.3f}   "
        f"within 2σ {np.mean(np.abs(error) < 2 * std):4.0%}"
    )

# %%
# Exercises
# ---------
# **1.** In the first figure, what changes if the constant is a random walk with a standard deviation of 0.1 from sample to sample? Why
# does the mistake of the naive rule become smaller?
#
# **2.** Show that the right rule makes the window equal a Kalman filter, whatever N is.

# %%
# Solutions
# ---------
# **1.** A walk forgets: what has been counted too often loses its weight. The ratio falls from 3.3 towards one as the steady state of
# the Kalman filter needs fewer samples than the window holds. For parameters, which hardly walk, nothing forgets.
#
# **2.** Run both on the same recording:

linear = bs.sdof(k=40.0, b=0.8, c=1.0)
one = bs.simulate(linear, push, dt=0.05, sigma_y=2e-3, seed=3)
start = bs.Prior(sigma_x0={"q": 0.1, "v": 0.1})
kalman = bs.estimate(bs.KalmanFilter(noise, start), linear, one)
for horizon in (1, 8):
    moving = bs.estimate(bs.MHE(noise, start, N=horizon), linear, one)
    off = np.abs(moving.x_hat - kalman.x_hat).max() / kalman.x_std.min()
    print(f"N = {horizon}: at most {float(off):.1e} standard deviations away")

# %%
# By Bayes' rule: the information of the past about the first state of the window is a Kalman filter's prediction, and the window
# adds what its own samples say. Nothing is lost and nothing counted twice.
#
# **Read on.** Rao, Rawlings, Lee, *Constrained linear state estimation: a moving horizon approach*, 2001,
# doi:10.1016/S0005-1098(01)00115-7.
