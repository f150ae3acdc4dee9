"""
Observability
=============

An estimator turns outputs into states. Whether that is possible is no question of the estimator: two motions that look alike to
every sensor cannot be told apart by anybody.
"""

# %%
# Derivatives of the output
# -------------------------
# Of a linear model :math:`\dot x = A x,\ y = C x` the output and its derivatives are
#
# .. math::
#
#    \begin{pmatrix} y \\ \dot y \\ \vdots \\ y^{(n-1)} \end{pmatrix}
#    = \begin{pmatrix} C \\ C A \\ \vdots \\ C A^{n-1} \end{pmatrix} x = \mathcal{O}\, x .
#
# If the rank of :math:`\mathcal{O}` is n, the state can be computed from them (Kalman 1960). Two masses on springs, of which
# the position of the first is measured:

import numpy as np
from scipy.linalg import expm

import backsight as bs
from backsight import plot


def two_masses(wall, between):
    """Stiffness by mass to the wall and between the masses [1/s2]."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = [[-wall - between, between], [between, -between]]
    A[2:, 2:] = -0.3 * np.eye(2)
    return A


def observability_matrix(A, C):
    """C, C A, ... above each other."""
    rows = [C]
    while len(rows) < len(A):
        rows.append(rows[-1] @ A)
    return np.vstack(rows)


first = np.array([[1.0, 0.0, 0.0, 0.0]])
for between in (50.0, 0.0):
    rank = np.linalg.matrix_rank(observability_matrix(two_masses(100.0, between), first))
    print(f"spring between the masses {between:4.0f} 1/s2: rank {rank} of 4")

# %%
# Rank is yes or no, noise is not
# -------------------------------
# A weak spring tells of the second mass, but quietly. How much the sensors say about every direction of the state within a time
# is the *Gramian*, the sum of what all samples say:
#
# .. math:: W = \sum_k (C \Phi^k)^\top R^{-1} C \Phi^k ,
#
# and its inverse is the covariance that the best estimator can reach from these samples alone. So rank is the wrong question;
# the right one is how large the band of every state is.

DT, SAMPLES, SIGMA = 0.02, 500, 1e-3


def reachable(between):
    """Standard deviations of the start from 10 s of the sensor."""
    step, row = expm(DT * two_masses(100.0, between)), first.copy()
    W = np.zeros((4, 4))
    for _ in range(SAMPLES):
        W += row.T @ row / SIGMA**2
        row = row @ step
    return np.sqrt(np.diag(np.linalg.inv(W)))


springs = np.geomspace(0.01, 100.0, 25)
bands = np.array([reachable(b) for b in springs])
made = plot.figure()
axes = made.axes[0]
plot.line(axes, springs, bands[:, 0], name="first mass, measured", series=0)
plot.line(axes, springs, bands[:, 1], name="second mass, not measured", series=1)
axes.set_xscale("log")
axes.set_yscale("log")
plot.label(
    axes, "standard deviation that can be reached", "m", x="spring between the masses [1/s2]"
)
plot.legend(axes)
made

# %%
# The rank is 4 everywhere in this picture. At its left end the second mass is known to a metre, from a sensor of 1 mm. The filter says the same by its
# covariance, without a theory: where its band stays that of the prior, nothing was observed.

# %%
# Parameters: a question of the motion
# ------------------------------------
# An unknown stiffness is a state that does not move. The model is then not linear, and what the outputs say depends on where it
# goes: at rest a spring of any stiffness does nothing. ``check_observability_along`` asks along a motion.

joint = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k", "b"])
for name, force in {
    "at rest": np.zeros(200),
    "pushed": np.sign(np.sin(0.1 * np.arange(200))),
}.items():
    print(f"{name}: {bs.check.check_observability_along(joint, force[:, None], dt=0.02)}")

# %%
# Exercises
# ---------
# **1.** One more sensor for a spring of 1 1/s2: which helps the second mass most: the position of the first mass once more, the speed of
# the first one with noise of 1 mm/s, or a cheap accelerometer on the second one with noise of 50 mm/s2?
#
# **2.** The bias of an accelerometer is to be estimated beside position and speed. Observable with the accelerometer alone? And with
# a position sensor?
#
# **3.** Why is a constant force on the second mass not observable from accelerations?

# %%
# Solutions
# ---------
# **1.** The accelerometer, although it is the coarsest: it is at the place. On the first mass nothing helps but the root of two, for
# what limits there is how little of the second mass arrives.


def with_second(row):
    """Bands of the start with one more row of C."""
    step, C = expm(DT * two_masses(100.0, 1.0)), np.vstack([first[0], row])
    W = np.zeros((4, 4))
    for _ in range(SAMPLES):
        W += C.T @ C / SIGMA**2
        C = C @ step
    return np.sqrt(np.diag(np.linalg.inv(W)))


further = {
    "position again": first[0],
    "speed": np.array([0.0, 0, 1, 0]),
    "accelerometer": two_masses(100.0, 1.0)[3] * SIGMA / 0.05,  # in units of its noise
}
for name, row in further.items():
    print(f"{name:15}: second mass ± {1e3 * with_second(row)[1]:.2f} mm")

# %%
# **2.** With the accelerometer as an input and no output there is nothing to observe at all; with a position sensor all three are:

drifting = np.array([[0.0, 1, 0], [0, 0, -1], [0, 0, 0]])  # position, speed, bias
print(np.linalg.matrix_rank(observability_matrix(drifting, np.array([[1.0, 0, 0]]))), "of 3")

# %%
# **3.** A constant force moves the masses to another place and nothing else: at rest the accelerations are zero whatever it is. In
# matrices: the state at rest under the force is an eigenvector of A with eigenvalue 0 that C does not see (the test of Popov,
# Belevitch and Hautus), and the rank says so.

loaded = np.zeros((5, 5))
loaded[:4, :4], loaded[3, 4] = two_masses(100.0, 50.0), 1.0
for name, C in {"acceleration": loaded[2:3], "position": np.eye(5)[:1]}.items():
    print(f"{name}: rank {np.linalg.matrix_rank(observability_matrix(loaded, C))} of 5")

# %%
# **Read on.** Kalman, *On the general theory of control systems*, 1960, doi:10.1016/S1474-6670(17)70094-8.
# Hermann, Krener, *Nonlinear controllability and observability*, 1977, doi:10.1109/TAC.1977.1101601.
