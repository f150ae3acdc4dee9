"""The Kalman filter of a large time-invariant model, whose gain is reused once it has converged."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.update import measured
from backsight.discrete.riccati import riccati_limit
from backsight.engine.dense import triangle
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.kalman.ekf import settled
from backsight.estimators.parts.covariance import (
    Covariance,
    congruence,
    joseph_form,
    matrix_product,
    weighted_gain,
)
from backsight.estimators.parts.filtering import PriorMemory, data_inputs, estimate_told
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.linear import Linear
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import moved_state, seen_outputs
from backsight.estimators.steady import Limit, kept_parts, limit_of, reused
from backsight.types import Array


def limit(system: Linear) -> Limit | None:
    """Where the covariance of the prediction goes while all outputs are measured; None if nowhere.

    Also None of few states, whose covariance costs next to nothing, and of noise that changes.
    """
    s, A, C = system.s, system.A, system.C
    if not Covariance(s.model.nx).whole or s.parts:
        return None

    def closed(P: Array) -> tuple[Array, Array]:
        AK = A @ np.linalg.solve(C @ P @ C.T + s.R, C @ P).T
        return A - AK @ C, s.Q + AK @ s.R @ AK.T

    return limit_of(riccati_limit(A, C, s.Q, s.R), closed)


def reusing(name: str, system: Linear, limit: Limit) -> Recursion:
    """Recursion of the filter, which takes its gain from the last sample where it can.

    The memory holds the prior of the coming sample before the ramp of an interpolated input.
    """
    s = system.s
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    step = covariance_step(system)
    m = Memory(x=s.x0, **kept_parts(step, limit, s.P0), started=0)
    now = reused(step, limit, m, mask)

    prior = m.x
    if system.ramp:
        prior += m.started * matrix_product(ca.sparsify(ca.DM(system.B_next)), u)
    e = _missed(system)(y, seen_outputs(s)(prior, u)[0], mask)
    free = prior + matrix_product(now["K"], e)
    variances = (_diagonal(now[k], n) for k, n in (("spread", s.model.nx), ("S", s.model.ny)))
    x, flags = settled(s)(free, *variances)
    x_next, _ = moved_state(s, s.integrator)(x, u, u)
    x_hat, y_hat, status = estimate_told(s, x=x, u=u, flags=flags)
    outputs = {
        "x_hat": x_hat, "P": now["spread"], "y_hat": y_hat, "e": ca.DM(s.sy) * e, "S": now["S"],
        "status": status,
    }  # fmt: skip
    plain = m.recursion(
        name, data, next={"x": x_next, **now, "started": 1}, outputs=outputs,
        channels=ESTIMATE_CHANNELS, dt=s.dt, innovation=_innovation(system, m, data),
    )  # fmt: skip
    kept = Covariance(s.model.nx)
    behind = plain.carry0[s.model.nx + kept.size :]
    return dataclasses.replace(plain, start=PriorMemory(kept.kept, s.sx, behind))


def covariance_step(system: Linear) -> ca.Function:
    """``(P, mask) -> (P, K, spread, S)``: of the next prediction, the gain, and physical triangles.

    Triangles of the covariances of the estimate and of the innovation.
    """
    s, kept = system.s, Covariance(system.s.model.nx)
    P, mask = ca.MX.sym("P", kept.size), ca.MX.sym("mask", s.model.ny)
    C = seen_outputs(s)(ca.MX.zeros(s.model.nx), ca.MX.zeros(s.model.nu))[1]
    K, S, noise = weighted_gain(kept.opened(P), C, s.R, mask)
    after = joseph_form(kept.opened(P), K, C, noise)
    ahead = kept.closed(congruence(_transition(system), after, s.Q))
    results = [ahead, K, triangle(after, s.sx), triangle(S, s.sy)]
    return ca.Function(
        "covariance", [P, mask], results, ["P_prior", "mask"], ["P", "K", "spread", "S"]
    )


def _transition(system: Linear) -> ca.MX:
    """A, with its entries only if these are few."""
    s = system.s
    still = ca.MX.zeros(s.model.nu)
    return moved_state(s, s.integrator)(ca.MX.zeros(s.model.nx), still, still)[1]


def _missed(system: Linear) -> ca.Function:
    """``(y, expected, mask) -> e``: 0 where not measured."""
    ny = system.s.model.ny

    def formula(y: ca.SX, expected: ca.SX, mask: ca.SX) -> Results:
        return {"e": measured(mask) * (y - expected)}

    return leaf("missed", {**notation(system.s), "expected": ny}, formula)


def _innovation(system: Linear, m: Memory, data: list[ca.MX]) -> ca.Function | None:
    return None


def _diagonal(triangle: ca.MX, n: int) -> ca.MX:
    """Diagonal of a lower triangle."""
    return triangle[np.cumsum([0, *range(n, 1, -1)]).tolist()]
