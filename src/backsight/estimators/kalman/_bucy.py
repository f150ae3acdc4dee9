r"""The extended Kalman filter for measurements that go on between the samples (Kalman-Bucy).

.. math::
    \dot{\hat x} = f(\hat x, u) + K (y - h(\hat x)), \qquad K = P H' R_c^{-1}, \qquad
    \dot P = F P + P F' - K H P + Q

with the spectral density R_c. An explicit method integrates this only in steps that are short
against the filter's own time constants, which small noise makes arbitrarily short. Here every
sub-step of length h is a prediction followed by a correction with the interpolated measurement of
variance :math:`R_c / h`. That has the same limit for h to 0, and P stays positive for every h.

Numbers are those of eq. 13-14 of Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint
state and parameter estimation: a comparison to extended and unscented Kalman filter".
"""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import measured
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, Setting
from backsight.estimators.parts import gaussian
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical


def assemble_continuous(name: str, s: Setting, integrator: Integrator) -> Recursion:
    """Recursion of the filter of eq. 13-14.

    The carry holds the estimate of the last sample; a step goes from there to the present, since
    interpolating the measurement needs the present one. Innovations are those of the model's
    prediction from sample to sample.
    """
    if not s.model.continuous:
        raise TuningError("measurement='continuous' needs a continuous-time model")
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    nu, ny, n_flags = s.model.nu, s.model.ny, len(gaussian.FLAGS)
    memory = {
        "x": s.x0,
        "P": packed(s.P0),
        "u_last": np.zeros(nu),
        "y_last": np.zeros(ny),
        "m_last": np.zeros(ny),
        "started": np.zeros(1),
    }
    symbol, (x, P, u_last, y_last, m_last, started) = carry_inputs(list(memory.values()))
    predicted = gaussian.predict(s, integrator, "transition").call([x, P, u_last, u])
    e, S = gaussian.innovation(s)(*choose(started, predicted, [x, P]), u, y, mask)

    inputs, held = gaussian.substep_inputs(integrator, u_last, u)
    measured = _between(ny, integrator.substeps)(y_last, y, m_last, mask)
    start = [x, P, ca.MX.zeros(n_flags)]
    leaf = _substep(s, integrator)
    moved, _ = scan(leaf, integrator.substeps, carry=start, xs=[*inputs, *measured], constants=held)
    x, P, flags = choose(started, moved, start)
    outputs = physical(s)(x, P, u, e, S, flags)
    carry = ca.vertcat(x, P, u, y, mask, 1)
    return Recursion(
        step=ca.Function(name, [symbol, *data], [carry, *outputs]),
        carry0=np.concatenate(list(memory.values())),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )


def _between(ny: int, n: int) -> ca.Function:
    """Measurements at the ends of the sub-steps and what they weigh: ``-> (Y, W)``, (ny, n) each.

    A channel that was measured at both ends is interpolated and weighs 1/n in every sub-step;
    measured at the present end only, it weighs 1 there, as a sample does. Where the noise of the
    ends is not the nominal one, the weights are multiplied by the square of the mask between them.
    """
    ya, yb, ma, mb = (ca.SX.sym(k, ny) for k in ("ya", "yb", "ma", "mb"))
    seen = measured(mb)
    both = measured(ma) * seen
    Y, W = [], []
    for k in range(1, n + 1):
        Y.append(ca.if_else(both, ya + k / n * (yb - ya), yb))
        m = ca.if_else(both, ma + k / n * (mb - ma), mb)
        W.append(m**2 * (both / n + (seen - both) * (k == n)))
    return ca.Function(f"between_{n}", [ya, yb, ma, mb], [ca.horzcat(*Y), ca.horzcat(*W)])


def _substep(s: Setting, integrator: Integrator) -> ca.Function:
    """Prediction and correction over one sub-step: ``(x, P, flags, ...) -> (x, P, flags)``."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, vP = ca.SX.sym("x", nx), ca.SX.sym("P", nx * (nx + 1) // 2)
    flags = ca.SX.sym("flags", len(gaussian.FLAGS))
    ua, ub = ca.SX.sym("ua", nu), ca.SX.sym("ub", nu)
    y, weight = ca.SX.sym("y", ny), ca.SX.sym("weight", ny)
    prior = gaussian.transition(s, integrator, s.dt / integrator.substeps).call([x, vP, ua, ub])
    ramp = integrator.hold == "foh"
    *posterior, raised = _weighted(s).call([*prior, ub if ramp else ua, y, weight])
    data = [ua, ub, y, weight] if ramp else [y, weight, ua, ub]
    return ca.Function(
        "continuous_substep", [x, vP, flags, *data], [*posterior, ca.fmax(flags, raised)]
    )


def _weighted(s: Setting) -> ca.Function:
    """Correction with measurements of variance R / weight: ``-> (x, P, flags)``."""
    nx, ny = s.model.nx, s.model.ny
    x, vP = ca.SX.sym("x", nx), ca.SX.sym("P", nx * (nx + 1) // 2)
    u, y, weight = ca.SX.sym("u", s.model.nu), ca.SX.sym("y", ny), ca.SX.sym("weight", ny)
    mask = weight > 0
    size = ca.diag(1 / ca.sqrt(ca.if_else(mask, weight, 1)))
    R = size @ ca.SX(s.R) @ size
    x_post, P_post, flags = gaussian.updated(s, x, unvech(vP), u, y, mask, R)
    return ca.Function("weighted", [x, vP, u, y, weight], [x_post, vech(P_post), flags])
