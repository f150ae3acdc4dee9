r"""The extended Kalman filter for measurements that go on between the samples (Kalman-Bucy).

.. math::
    \dot{\hat x} = f(\hat x, u) + K (y - h(\hat x)), \qquad K = P H' R_c^{-1}, \qquad
    \dot P = F P + P F' - K H P + Q

with the spectral density R_c. An explicit method integrates this only in steps that are short
against the filter's own time constants, which small noise makes arbitrarily short. Here every
sub-step of length h is a prediction followed by a correction with the interpolated measurement of
variance :math:`R_c / h`. That has the same limit for h to 0, and P stays positive for every h.

A held input jumps at the samples, and with it an output that it feeds through to (an acceleration).
The measurement of a sample belongs to the input that follows; for the sub-steps before it, it is
taken without the jump, :math:`y_k - h(\hat x_k, u_k) + h(\hat x_k, u_{k-1})`.

Numbers are those of eq. 13-14 of Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint
state and parameter estimation: a comparison to extended and unscented Kalman filter".
"""

from collections.abc import Callable

import casadi as ca
import numpy as np

from backsight.algebra.update import measured
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.parts.covariance import Covariance, Term
from backsight.estimators.parts.filtering import Halves, choose, data_inputs, physical
from backsight.estimators.parts.flags import FLAGS, raised_in_either
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import substep_inputs
from backsight.estimators.scaled import Setting


def assemble_continuous(
    name: str, s: Setting, halves: Halves, *, transition: ca.Function, integrator: Integrator
) -> Recursion:
    """Recursion of the filter of eq. 13-14.

    The carry holds the estimate of the last sample; a step goes from there to the present, since
    interpolating the measurement needs the present one. Innovations are those of the model's
    prediction from sample to sample.

    Parameters
    ----------
    name : str
    s : Setting
    halves : Halves
        Of the extended Kalman filter.
    transition : casadi.Function
        Its prediction over one sub-step, ``(x, P, ua, ub) -> (x, P)``.
    integrator : Integrator
    """
    if not s.model.continuous:
        raise TuningError("measurement='continuous' needs a continuous-time model")
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    nothing = np.zeros(s.model.ny)
    m = Memory(
        x=s.x0,
        P=halves.spread_of(s.P0),
        u_last=np.zeros(s.model.nu),
        y_last=nothing,
        m_last=nothing,
        started=0,
    )
    # The innovation is that of the model's prediction.
    predicted = halves.predict.call([m.x, m.P, m.u_last, u])
    e, S = halves.innovation(*choose(m.started, predicted, [m.x, m.P]), u, y, mask)

    # Eq. 13-14 in sub-steps, with the interpolated measurement.
    inputs, held = substep_inputs(integrator, m.u_last, u)
    y_before = y if integrator.hold == "foh" else _before_jump(s)(y, predicted[0], m.u_last, u)
    ends = _between(s.model.ny, integrator.steps)(m.y_last, y_before, m.m_last, mask)
    start = [m.x, m.P, ca.MX.zeros(FLAGS)]
    leaf = _substep(s, transition, halves.correct, ramp=integrator.hold == "foh")
    moved, _ = scan(leaf, integrator.steps, carry=start, xs=[*inputs, *ends], constants=held)
    x, P, flags = choose(m.started, moved, start)
    return m.recursion(
        name,
        data,
        next={"x": x, "P": P, "u_last": u, "y_last": y, "m_last": mask, "started": 1},
        outputs=physical(s, x=x, P=halves.covariance(P), u=u, e=e, S=S, flags=flags),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )


def _before_jump(s: Setting) -> ca.Function:
    """Measurement as it was just before the input jumped: ``(y, x, u_last, u) -> y``."""
    x, before, after = (ca.SX.sym(k, n) for k, n in (("x", s.model.nx), *[("u", s.model.nu)] * 2))
    y, h = ca.SX.sym("y", s.model.ny), s.model.output
    jumps = ca.depends_on(h(x, after), after)
    left = y - (h(x, after) - h(x, before)) if jumps else y
    return ca.Function("before_jump", [y, x, before, after], [left])


def _between(ny: int, n: int) -> ca.Function:
    """Measurements at the ends of the sub-steps and their masks: ``-> (Y, M)``, (ny, n) each.

    A channel that was measured at both ends is interpolated and weighs 1/n in every sub-step;
    measured at the present end only, it weighs 1 there, as a sample does. The mask is the root of
    the weight; where the noise of the ends is not the nominal one, times the mask between them.
    """
    ya, yb, ma, mb = (ca.SX.sym(k, ny) for k in ("ya", "yb", "ma", "mb"))
    seen = measured(mb)
    both = measured(ma) * seen
    Y, M = [], []
    for k in range(1, n + 1):
        Y.append(ca.if_else(both, ya + k / n * (yb - ya), yb))
        m = ca.if_else(both, ma + k / n * (mb - ma), mb)
        M.append(m * ca.sqrt(both / n + (seen - both) * (k == n)))
    return ca.Function(f"between_{n}", [ya, yb, ma, mb], [ca.horzcat(*Y), ca.horzcat(*M)])


def _substep(
    s: Setting, transition: ca.Function, correct: ca.Function, *, ramp: bool
) -> ca.Function:
    """Prediction and correction over one sub-step: ``(x, P, flags, ...) -> (x, P, flags)``."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    kept = Covariance(nx)
    symbol: Callable[..., Term] = ca.MX.sym if kept.whole else ca.SX.sym
    x, P, flags = symbol("x", nx), symbol("P", kept.size), symbol("flags", FLAGS)
    ua, ub, y, mask = symbol("ua", nu), symbol("ub", nu), symbol("y", ny), symbol("mask", ny)
    prior = transition.call([x, P, ua, ub])
    *posterior, raised = correct.call([*prior, ub if ramp else ua, y, mask])
    data = [ua, ub, y, mask] if ramp else [y, mask, ua, ub]
    results = [*posterior, raised_in_either(flags, raised)]
    return ca.Function("continuous_substep", [x, P, flags, *data], results)
