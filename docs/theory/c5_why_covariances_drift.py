r"""
Why P - K S K' drifts
=====================

Four formulas for the covariance after a measurement are equal on paper. On a computer one of them drifts away, with a filter that
forgets nothing of its rounding, and another one believes in a sensor without noise. Measured, with the reason.
"""

# %%
# Four formulas
# -------------
# With :math:`S = H P H^\top + R` and :math:`K = P H^\top S^{-1}`:
#
# .. math::
#
#    P^+ &= P - K S K^\top                                  && \text{(a) subtraction} \\
#    P^+ &= (I - K H) P                                     && \text{(b) short form} \\
#    P^+ &= (I - K H) P (I - K H)^\top + K R K^\top         && \text{(c) Joseph} \\
#    P^+ &= L^+ {L^+}^\top                                  && \text{(d) a root, by a QR factorisation}

import numpy as np

from backsight import plot


def subtraction(P, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T / S
    return P - K @ S @ K.T


def short(P, H, R):
    K = P @ H.T / (H @ P @ H.T + R)
    return P - K @ H @ P


def joseph(P, H, R):
    K = P @ H.T / (H @ P @ H.T + R)
    rest = np.eye(len(P), dtype=P.dtype) - K @ H
    return rest @ P @ rest.T + K @ R @ K.T


def root(P, H, R):
    """The root is made anew of P at every sample; a filter would keep it."""
    w, V = np.linalg.eigh(P)
    L = V * np.sqrt(np.maximum(w, 0))
    above = np.hstack([np.sqrt(R), H @ L])
    below = np.hstack([np.zeros((len(P), 1), P.dtype), L])
    corner = np.linalg.qr(np.vstack([above, below]).T, mode="r").T[1:, 1:]
    return corner @ corner.T


forms = {"subtraction": subtraction, "short": short, "Joseph": joseph, "root": root}

# %%
# A stage with a good encoder
# ---------------------------
# Position, speed and acceleration, known to a metre, a metre per second and ten metres per second squared at the start; an encoder of a
# micrometre, a thousand times a second. Single precision, as on many controllers; Joseph's form in extended precision is the
# yardstick.

DT = 1e-3
step = np.array([[1, DT, DT**2 / 2], [0, 1, DT], [0, 0, 1]])
walk = np.diag([0.0, 0.0, 1e-6])
encoder, noise = np.array([[1.0, 0, 0]]), np.array([[1e-12]])


def run(form, kind, samples=3000):
    """Covariances (samples, 3, 3) after every measurement."""
    P = np.diag([1.0, 1.0, 100.0]).astype(kind)
    F, Q, H, R = (m.astype(kind) for m in (step, walk, encoder, noise))
    every = []
    for _ in range(samples):
        P = form(P, H, R)
        every.append(P)
        P = F @ P @ F.T + Q
    return np.array(every, dtype=float)


def skew(P):
    """Size of the skew part beside the whole, by sample."""
    return np.linalg.norm(P - P.transpose(0, 2, 1), axis=(1, 2)) / np.linalg.norm(P, axis=(1, 2))


yardstick = run(joseph, np.longdouble)
single = {name: run(form, np.float32) for name, form in forms.items()}
made = plot.figure(2, height=2.2)
for i, (name, P) in enumerate(single.items()):
    off = np.abs(P[:, 1, 1] / yardstick[:, 1, 1] - 1.0)
    plot.line(made.axes[0], np.arange(len(P)), np.maximum(off, 1e-9), name=name, series=i)
    plot.line(made.axes[1], np.arange(len(P)), np.maximum(skew(P), 1e-9), name=name, series=i)
for axes in made.axes:
    axes.set_yscale("log")
plot.label(made.axes[0], "relative error of the variance of the speed", "1")
plot.label(made.axes[1], "skew part of P by P", "1", x="sample")
plot.legend(made.axes[0])
made

# %%
for name, P in single.items():
    smallest = min(np.linalg.eigvalsh(p / 2 + p.T / 2)[0] for p in P)
    print(
        f"{name:12} variance of the speed off by {abs(P[-1, 1, 1] / yardstick[-1, 1, 1] - 1):7.1e}   "
        f"smallest eigenvalue {smallest:8.1e}"
    )

# %%
# Three formulas stay within the rounding of single precision. The subtraction leaves it, and goes on.

# %%
# The reason
# ----------
# Let P have an error E. To first order (a) makes of it
#
# .. math:: E^+ = E - E H^\top K^\top - K H E^\top .
#
# A *symmetric* error becomes :math:`(I - K H) E (I - K H)^\top` but for small terms: the filter forgets it as it forgets errors of its
# state. Of a *skew* error, :math:`E^\top = -E`, the two last terms have opposite signs: nothing makes it smaller, and the prediction
# :math:`F E F^\top` makes it larger with every sample. Rounding is not symmetric, because :math:`F P F^\top` is rounded in another
# order on either side of the diagonal. So the drift begins with the last digit and ends where nothing is right
# (Verhaegen, Van Dooren 1986).
#
# That suggests the cure: make it symmetric, or compute one triangle only.


def symmetric(P, H, R):
    P = subtraction(P, H, R)
    return (P + P.T) / 2


cured = run(symmetric, np.float32)
print(f"variance of the speed off by {abs(cured[-1, 1, 1] / yardstick[-1, 1, 1] - 1):.1e}")

# %%
# What symmetry does not cure
# ---------------------------
# The first measurement leaves a variance of :math:`10^{-12}` of the position. Both subtractions compute it as the difference of two
# numbers of size one, with seven digits:

start = np.diag([1.0, 1.0, 100.0]).astype(np.float32)
for name, form in (forms | {"symmetric": symmetric}).items():
    after = form(start, encoder.astype(np.float32), noise.astype(np.float32))
    print(f"{name:12} variance of the position {after[0, 0]:8.1e}, should be 1.0e-12")

# %%
# Zero: the filter believes the encoder to the last digit, and a little more rounding makes the variance negative; then the gain has the
# wrong sign. Double precision moves the edge from :math:`10^{7}` to :math:`10^{16}` and does not remove it: a prior of a metre and an
# interferometer of a nanometre are :math:`10^{18}` apart.

for name, form in forms.items():
    after = form(np.diag([1.0, 1.0, 100.0]), encoder, np.array([[1e-18]]))
    print(f"{name:12} variance of the position {after[0, 0]:8.1e}, should be 1.0e-18")

# %%
# What Backsight does
# -------------------
# The filters use Joseph's form or a root, which only add what is positive, with every state measured by its own scale; of
# symmetric matrices one triangle is computed. What is not finite or not positive any more is a status of its sample.

# %%
# Exercises
# ---------
# **1.** Does the drift need many samples, or a good encoder? Try an encoder of a millimetre.
#
# **2.** Choose units in which the prior is 1 and the noise of the encoder is, too. Does that help?

# %%
# Solutions
# ---------
# **1.** Samples: the skew part grows with a worse encoder, too, only from a smaller beginning.

noise = np.array([[1e-6]])
coarse, right = run(subtraction, np.float32), run(joseph, np.longdouble)
for k in (10, 100, 1000, 2999):
    print(f"after {k:4} samples off by {abs(coarse[k, 1, 1] / right[k, 1, 1] - 1):.1e}")

# %%
# **2.** No: what is lost is the *ratio* of the variances before and after, and the prior and the noise of one quantity share its unit.
# Scales help between different states, whose sizes differ by powers of ten.
#
# **Read on.** Verhaegen, Van Dooren, *Numerical aspects of different Kalman filter implementations*, 1986,
# doi:10.1109/TAC.1986.1104128. Bierman, *Factorization Methods for Discrete Sequential Estimation*, 1977.
