"""The Kalman filter of a time-invariant model, whose gain is reused once it has converged."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra import update
from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.riccati import riccati_limit
from backsight.engine.dense import few_entries, triangle
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.parts.covariance import (
    Covariance,
    congruence,
    corrected_covariance,
    innovation_covariance,
    joseph_form,
    kalman_gain,
    matrix_product,
)
from backsight.estimators.parts.filtering import PriorMemory, data_inputs, estimate_told
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.linear import Linear
from backsight.estimators.parts.memory import Memory, diagonal_of_triangle
from backsight.estimators.parts.substeps import moved_state, seen_outputs, settled
from backsight.estimators.steady.reuse import kept_or_new, kept_parts, reused
from backsight.estimators.steady.state import SteadyState, steady_state
from backsight.types import Array

CHEAP = 12_000
"""Operations up to which the covariance of a sample costs no more than to keep what follows."""


def filter_limit(system: Linear) -> SteadyState | None:
    """Where the covariance of the prediction goes while all outputs are measured; None if nowhere.

    Also None of noise that changes, and where the covariance costs next to nothing.
    """
    s = system.s
    if s.parts or not may_be_worth(s.model.nx, s.model.ny):
        return None
    if not Covariance(s.model.nx).whole and _operations_of_few(system) <= CHEAP:
        return None
    return limit_of(system.A, system.C, s.Q, s.R)


def may_be_worth(nx: int, ny: int) -> bool:
    """Whether a filter of this size may have so much to do that its gain is worth keeping."""
    return Covariance(nx).whole or nx**2 * (7 * nx + 12 * ny) > CHEAP  # of matrices without zeros


def limit_of(A: Array, C: Array, Q: Array, R: Array) -> SteadyState | None:
    """The same for matrices of a model from sample to sample and the covariances of its noise."""

    def closed(P: Array) -> tuple[Array, Array]:
        AK = A @ np.linalg.solve(C @ P @ C.T + R, C @ P).T
        return A - AK @ C, Q + AK @ R @ AK.T

    return steady_state(riccati_limit(A, C, Q, R), closed)


def reusing_filter(name: str, system: Linear, limit: SteadyState) -> Recursion:
    """Recursion of the filter, which takes its gain from the last sample where it can.

    The memory holds the prior of the coming sample before the ramp of an interpolated input.
    """
    s = system.s
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    step = _covariance_step(system)
    m = Memory(x=s.x0, **kept_parts(step, limit, s.P0), started=0)
    now = reused(step, limit, m, mask)

    prior, e = _innovated(system, m, u, y, mask)
    free = prior + matrix_product(now["K"], e)
    variances = now["spread"][diagonal_of_triangle(s.model.nx)]
    of_innovation = now["S"][diagonal_of_triangle(s.model.ny)]
    x, flags = settled(s)(free, variances, of_innovation)
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


def _covariance_step(system: Linear) -> ca.Function:
    """``(P, mask) -> (P, K, spread, S)``: of the next prediction, the gain, and physical triangles.

    Triangles of the covariances of the estimate and of the innovation.
    """
    s, kept = system.s, Covariance(system.s.model.nx)
    if not kept.whole:
        return _covariance_step_of_few(system)
    P, mask = ca.MX.sym("P", kept.size), ca.MX.sym("mask", s.model.ny)
    C, A = (ca.MX(few_entries(matrix)) for matrix in (system.C, system.A))
    now = corrected_covariance(kept.opened(P), C, s.R, mask)
    ahead = kept.closed(congruence(A, now.P, s.Q))
    results = [ahead, now.K, triangle(now.P, s.sx), triangle(now.S, s.sy)]
    return ca.Function(
        "covariance", [P, mask], results, ["P_prior", "mask"], ["P", "K", "spread", "S"]
    )


def _covariance_step_of_few(system: Linear) -> ca.Function:
    """The same as straight-line code, with the formulas of `EKF`."""
    s = system.s
    P = ca.SX.sym("P", Covariance(s.model.nx).size)
    mask = ca.SX.sym("mask", s.model.ny)
    A, C, R = (ca.sparsify(ca.SX(ca.DM(matrix))) for matrix in (system.A, system.C, s.R))
    H, _, noise = update.masked(C, ca.SX.zeros(s.model.ny), R, mask)
    K, _ = kalman_gain(unvech(P), H, noise)
    after = joseph_form(unvech(P), K, H, noise)
    S = congruence(C, unvech(P), update.noise_of(R, mask))
    values = {
        "P": vech(congruence(A, after, s.Q)),
        "K": ca.densify(K @ ca.diag(mask)),
        "spread": _physical(after, s.sx),
        "S": _physical(S, s.sy),
    }
    names = ["P_prior", "mask"]
    return ca.Function("covariance", [P, mask], list(values.values()), names, list(values))


def _operations_of_few(system: Linear) -> int:
    return _covariance_step_of_few(system).n_instructions()


def _physical(P: ca.SX, scale: Array) -> ca.SX:
    """Lower triangle of a covariance."""
    return vech(P * ca.SX(ca.DM(np.outer(scale, scale))))


def _missed(system: Linear) -> ca.Function:
    """``(y, expected, mask) -> e``: 0 where not measured."""
    ny = system.s.model.ny

    def formula(y: ca.SX, expected: ca.SX, mask: ca.SX) -> Results:
        return {"e": update.measured(mask) * (y - expected)}

    return leaf("missed", {**notation(system.s), "expected": ny}, formula)


def _innovation(system: Linear, m: Memory, data: list[ca.MX]) -> ca.Function:
    """``(carry, u, y, mask) -> (e, S)`` before the sample enters, physical."""
    s, spread = system.s, _innovation_spread(system)
    u, y, mask = s.enter()(*data)
    e, S = _innovated(system, m, u, y, mask)[1], kept_or_new(spread, m, "S", m.P, mask=mask)
    return ca.Function("innovation", [m.symbol, *data], [ca.DM(s.sy) * e, S])


def _innovation_spread(system: Linear) -> ca.Function:
    """``(P, mask) -> S``, a physical triangle."""
    s, kept = system.s, Covariance(system.s.model.nx)
    if not kept.whole:
        few, weights = ca.SX.sym("P", kept.size), ca.SX.sym("mask", s.model.ny)
        noise = update.noise_of(ca.SX(ca.DM(s.R)), weights)
        S = congruence(ca.sparsify(ca.SX(ca.DM(system.C))), unvech(few), noise)
        return ca.Function("innovation_spread", [few, weights], [_physical(S, s.sy)])
    P, mask = ca.MX.sym("P", kept.size), ca.MX.sym("mask", s.model.ny)
    S = innovation_covariance(kept.opened(P), ca.MX(few_entries(system.C)), s.R, mask)
    return ca.Function("innovation_spread", [P, mask], [triangle(S, s.sy)])


def _innovated(system: Linear, m: Memory, u: ca.MX, y: ca.MX, mask: ca.MX) -> tuple[ca.MX, ca.MX]:
    """State before the sample enters, and innovation, scaled."""
    prior = m.x
    if system.ramp:
        prior += m.started * matrix_product(ca.sparsify(ca.DM(system.B_next)), u)
    return prior, _missed(system)(y, seen_outputs(system.s)(prior, u)[0], mask)
