"""
Sparsity
========

Eight unknown forces, three sensors, and yet one answer: if few of the forces act, the right explanation is the one with the fewest.
Why the sum of absolute values finds it, and when it does not.
"""

# %%
# A corner of a diamond
# ---------------------
# Let :math:`y = H \alpha` with more columns than rows. Infinitely many :math:`\alpha` explain y. Least squares takes the
# shortest, which is spread over everything; the fewest nonzero entries can be found only by trying. Between the two,
#
# .. math:: \min_\alpha \; \lVert y - H \alpha \rVert^2 + \lambda \lVert \alpha \rVert_1 ,
#
# is convex, and its solutions sit at corners of the diamond :math:`\lVert \alpha \rVert_1 \le c`, where entries are exactly zero.
# The simplest algorithm that solves it is a gradient step and a shrinkage (ISTA):

import itertools

import numpy as np

from backsight import plot


def lasso(H, y, lam, steps=3000):
    """Iterative shrinkage: factors that minimise the cost above."""
    step = 0.5 / np.linalg.norm(H, 2) ** 2
    alpha = np.zeros(H.shape[1])
    for _ in range(steps):
        moved = alpha + 2.0 * step * H.T @ (y - H @ alpha)
        alpha = np.sign(moved) * np.maximum(np.abs(moved) - lam * step, 0.0)
    return alpha


rng = np.random.default_rng(0)
H = rng.standard_normal((20, 60))
H /= np.linalg.norm(H, axis=0)
true = np.zeros(60)
true[[7, 23, 48]] = 3.0, -2.0, 1.5
y = H @ true + 0.02 * rng.standard_normal(20)

made = plot.figure(3, height=1.5)
shown = {
    "truth": true,
    "least squares": np.linalg.pinv(H) @ y,
    "l1 norm": lasso(H, y, lam=0.2),
}
for axes, (name, alpha) in zip(made.axes, shown.items(), strict=True):
    axes.vlines(np.arange(60), 0.0, alpha, color="#0072B2")
    plot.label(axes, name)
made.axes[-1].set_xlabel("place and moment", fontsize=8)
made

# %%
# Three of sixty are found from twenty equations, each a little too small: the price :math:`\lambda` is paid by the true ones, too,
# about :math:`\lambda / 2`. A last fit without the price removes that (``bias="removed"``).

# %%
# When it fails
# -------------
# Two columns that look alike cannot be told apart. The *coherence* is the largest correlation of two columns; up to
# :math:`(1 + 1/\mu) / 2` forces are found for certain (Donoho, Elad 2003). That is pessimistic, as a count shows:

mu = np.abs(H.T @ H - np.eye(60)).max()
print(f"coherence {mu:.2f}: certain for {int((1 + 1 / mu) / 2 - 1e-9)} force at a time")


def found(count, tries=12):
    """Share of random choices of so many columns that come out right."""
    good = 0
    for _ in range(tries):
        where = rng.choice(60, count, replace=False)
        alpha = np.zeros(60)
        alpha[where] = rng.choice([-1, 1], count) * rng.uniform(1, 3, count)
        estimate = lasso(H, H @ alpha, lam=0.02, steps=1500)
        good += set(np.flatnonzero(np.abs(estimate) > 0.3)) == set(where)
    return good / tries


counts = [1, 2, 3, 4, 5, 6, 8, 10]
made = plot.figure()
axes = made.axes[0]
plot.line(axes, np.array(counts), np.array([found(c) for c in counts]), name="found", series=0)
plot.label(
    axes, "share of trials in which exactly the true ones are found", "1", x="forces at a time"
)
made

# %%
# The edge is sharp: as long as few act, the l1 norm is as good as trying all combinations; beyond, it breaks down at once.

# %%
# Exercises
# ---------
# **1.** From which :math:`\lambda` on is nothing found?
#
# **2.** Neighbouring places of a beam have nearly the same column. Replace column 8 by column 7 with 5 % of something else; what is found
# of a force at 7?
#
# **3.** Try all pairs of columns for the data of the first figure's method with two forces. Do they agree with the l1 norm?

# %%
# Solutions
# ---------
# **1.** Where no step from zero pays: :math:`\lambda_{max} = 2 \max_i |h_i^\top y|` (``bs.tune.lambda_max``).

edge = 2.0 * np.abs(H.T @ y).max()
print(f"lambda_max {edge:.3f}: {np.count_nonzero(lasso(H, y, 1.001 * edge))} found just above,")
print(f"{np.count_nonzero(lasso(H, y, 0.99 * edge))} just below")

# %%
# **2.** With little noise it is found at the right place: 5 % of difference are more than the noise. With more noise the two places are a
# matter of luck; what is right is their sum.

alike = H.copy()
alike[:, 8] = H[:, 7] + 0.05 * rng.standard_normal(20)
for sigma in (0.02, 0.3):
    tried = [
        lasso(alike, 3.0 * alike[:, 7] + sigma * rng.standard_normal(20), 0.2, steps=800)
        for _ in range(12)
    ]
    right = sum(alpha[7] > alpha[8] for alpha in tried)
    together = np.mean([alpha[7] + alpha[8] for alpha in tried])
    print(f"noise {sigma:4}: at the right place in {right} of 12, sum {together:.2f} of 3")

# %%
# **3.** 1770 pairs, each a small least-squares problem:

pair = np.zeros(60)
pair[[11, 40]] = 2.0, -2.5
seen = H @ pair + 0.02 * rng.standard_normal(20)
cost = {
    two: np.linalg.lstsq(H[:, list(two)], seen, rcond=None)[1][0]
    for two in itertools.combinations(range(60), 2)
}
best = min(cost, key=cost.__getitem__)
print(best, "by trying,", np.flatnonzero(np.abs(lasso(H, seen, 0.2)) > 0.3), "by the l1 norm")

# %%
# **Read on.** Tibshirani, *Regression shrinkage and selection via the lasso*, 1996. Donoho, Elad, *Optimally sparse representation in
# general (nonorthogonal) dictionaries via l1 minimization*, 2003, doi:10.1073/pnas.0437847100.
