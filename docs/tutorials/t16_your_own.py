"""
Your own estimator
==================

A method that is not in the package is one class. It then runs on recordings and live, native and as C, with missing samples, in
comparisons and reports, and the contract that all estimators keep checks it.
"""

# %%
# A filter that forgets
# ---------------------
# An extended Kalman filter whose prior weighs less the older it is: ``P`` grows by ``alpha`` squared where something is
# measured.

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

import backsight as bs
from backsight import extend as ext
from backsight import plot


@dataclasses.dataclass(frozen=True)
class Fading(ext.AbstractEstimator):
    """EKF that forgets: what was measured m samples ago weighs alpha^(-2 m)."""

    key: ClassVar[str] = "fading"
    title: ClassVar[str] = "Fading-memory filter"

    noise: bs.Noise
    prior: bs.Prior
    alpha: float = 1.01
    integrator: bs.Integrator = dataclasses.field(default_factory=bs.Integrator)

    def build(self, model, dt):
        given = {"noise": self.noise, "prior": self.prior, "integrator": self.integrator}
        s = ext.setting(model, dt, **given)
        halves = ext.ekf_halves(s, s.integrator, "transition")
        return ext.assemble(self.key, s, dataclasses.replace(halves, correct=faded(s, self.alpha)))


def faded(s, alpha):
    """Measurement update, ``(x, P, u, y, mask) -> (x, P, flags)``."""

    def formula(x, P, u, y, mask):
        forget = ca.if_else(ca.sum1(mask) > 0, alpha**2, 1)
        x_post, P_post, flags = ext.updated(s, x, forget * P, u, y, mask)
        return {"x_post": x_post, "P_post": P_post, "flags": flags.vector()}

    return ext.half("correct", s, formula)


# %%
# Beside the others
# -----------------
# The stiffness drifts, and no walk was given for it: the filter that forgets follows, the other believes its past.

plant = bs.sdof(k=40.0, b=0.8, c=1.0)
force = np.sign(np.sin(0.05 * np.arange(2000)))[:, None]
recording = bs.simulate(
    plant,
    force,
    dt=0.01,
    sigma_y=1e-3,
    seed=1,
    changes={float(s): {"k": 40.0 - s} for s in range(5, 15)},
)
model = bs.augment(plant, parameters=["k"])
noise, prior = (
    bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-4}),
    bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 5.0}),
)
results = bs.compare(
    {"EKF": bs.EKF(noise, prior), "fading": Fading(noise, prior)}, model, recording
)
plot.draw_states(results, ["k"])

# %%
plot.draw_nis(results)
