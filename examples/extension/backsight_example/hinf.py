"""H-infinity filter."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight import Integrator, Model, Noise, Prior
from backsight import extend as ext
from backsight.errors import TuningError


@dataclasses.dataclass(frozen=True)
class HInfinity(ext.AbstractEstimator):
    r"""H-infinity filter, linearised at the estimate.

    The Kalman filter is right on average; this one bounds the worst case, whatever the noise does:
    the sum of the weighted squared errors stays below :math:`1 / \theta` times that of the squared
    noise and start errors (Simon, eq. 11.80). Its update is the Kalman filter's with a prior that
    is widened first (eq. 11.89 in information form),

    .. math::
        \tilde P = (P^{-1} - \theta \bar S)^{-1}, \quad
        K = \tilde P H' (H \tilde P H' + R)^{-1}, \quad
        \hat x^+ = \hat x^- + K (y - h(\hat x^-)), \quad
        P^+ = (\tilde P^{-1} + H' R^{-1} H)^{-1}.

    The weights are those of the prior, :math:`\bar S = \mathrm{diag}(P_0)^{-1}`, so that
    :math:`\theta` has no unit. Samples without a measurement are predicted.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    theta : float
        Bound on the performance; 0 is the extended Kalman filter. If P - the widened one - does
        not exist, the sample has the status *not positive definite*, and is not widened.
    integrator : Integrator
        For continuous-time models.

    References
    ----------
    Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, section 11.3.
    """

    key: ClassVar[str] = "hinf"
    title: ClassVar[str] = "H-infinity filter"

    noise: Noise
    prior: Prior
    theta: float = 0.01
    integrator: Integrator = dataclasses.field(default_factory=Integrator)

    def __post_init__(self) -> None:
        if not 0 <= self.theta < 1:
            raise TuningError(f"theta is {self.theta}; it must be at least 0 and below 1")

    def build(self, model: Model, dt: float) -> ext.Recursion:
        """See `AbstractEstimator.build`."""
        s = ext.setting(model, dt, noise=self.noise, prior=self.prior, integrator=self.integrator)
        halves = ext.ekf_halves(s, s.integrator, "transition")
        correct = _correct(s, self.theta)
        return ext.assemble(self.key, s, dataclasses.replace(halves, correct=correct))


def _correct(s: ext.Setting, theta: float) -> ca.Function:
    """Measurement update: ``(x, P, u, y, mask) -> (x, P, flags)``."""
    d = 1 / np.sqrt(np.diag(s.P0))
    identity, both, left = np.eye(len(d)), np.outer(d, d), np.tile(d[:, None], len(d))

    def formula(x, P, u, y, mask):
        # 1. Widen the prior: (P^-1 - theta D D)^-1 by the matrix inversion lemma, D = S^(1/2).
        M = ca.DM(identity) - theta * (P * ca.DM(both))
        exists, DP = ext.definite(M), P * ca.DM(left)
        wide = P + theta * ext.times_transposed(DP.T, ext.solve_definite(M, DP).T)
        use = ca.logic_and(exists, ca.sum1(mask) > 0)
        prior = ca.if_else(use, (wide + wide.T) / 2, P)

        # 2. The update of the extended Kalman filter, with bounds and missing rows.
        x_post, P_post, flags = ext.updated(s, x, prior, u, y, mask)
        failed = ca.fmax(flags.not_positive_definite, ca.logic_not(exists))
        flags = dataclasses.replace(flags, not_positive_definite=failed)
        return {"x_post": x_post, "P_post": P_post, "flags": flags.vector()}

    return ext.half("correct", s, formula)
