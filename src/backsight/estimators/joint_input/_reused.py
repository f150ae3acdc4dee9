"""The joint input filter of many states, whose gains are reused once they have converged."""

import casadi as ca
import numpy as np
import scipy

from backsight.discrete.riccati import riccati_limit
from backsight.engine.dense import few_entries, triangle
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.around.virtual import CROSS
from backsight.estimators.joint_input._many import many_states, many_weights, raised
from backsight.estimators.joint_input._system import Forces
from backsight.estimators.parts.covariance import (
    Covariance,
    congruence,
    symmetric_part,
    times_transposed,
)
from backsight.estimators.parts.filtering import estimate_told
from backsight.estimators.parts.leaf import named_results
from backsight.estimators.parts.memory import Memory
from backsight.estimators.steady import SteadyState, kept_parts, reused, steady_state
from backsight.types import Array


def joint_limit(found: Forces) -> SteadyState | None:
    """Where the covariance of the prediction goes while all outputs are measured; None if nowhere.

    Also None of few states, whose covariance costs next to nothing. Where outputs contain the force
    before, the prediction without it goes on by A and the force by A E.
    """
    system, s = found.system, found.system.s
    A, C, R, H = system.A, system.C, s.R, found.H
    E = found.E if found.direct else A @ found.E
    if not Covariance(s.model.nx).whole:
        return None

    def closed(P: Array) -> tuple[Array, Array]:
        S = C @ P @ C.T + R
        K, W = np.linalg.solve(S, C @ P).T, np.linalg.solve(S, H)
        M = np.linalg.solve(H.T @ W, W.T)
        gain = A @ (K - K @ H @ M) + E @ M
        return A - gain @ C, s.Q + gain @ R @ gain.T

    # Outputs in which no force is, and a force that is what the others say: d = M (y - C x - v).
    # With M = (H' R^-1 H)^-1 H' R^-1 the noise of both is independent.
    W = np.linalg.solve(R, H)
    told = np.linalg.inv(H.T @ W)
    free = scipy.linalg.null_space(H.T)
    start = riccati_limit(
        A - E @ told @ W.T @ C, free.T @ C, s.Q + E @ told @ E.T, free.T @ R @ free
    )
    return steady_state(start, closed)


def reusing_joint(
    name: str, found: Forces, limit: SteadyState, data: list[ca.MX], channels: tuple[Channel, ...]
) -> Recursion:
    """Recursion of the filter, which takes its gains from the last sample where it can."""
    s = found.system.s
    step = _covariance_step(found, cross=any(c.name == CROSS for c in channels))
    m = Memory(x=s.x0, **kept_parts(step, limit, s.P0), started=0)
    gains = reused(step, limit, m, data[2], m.started)
    now = named_results(many_states(found), m.x, gains["L"], gains["M"], m.started, *data)
    flags = raised()(now["clipped"], gains["unobserved"])
    x_hat, y_hat, status = estimate_told(s, x=now["x_post"], u=now["v"], flags=flags)
    outputs = {
        "x_hat": x_hat, "P": gains["spread"], "y_hat": y_hat, "e": ca.DM(s.sy) * now["e"],
        "S": gains["S"], "status": status, "d_hat": now["d"], "P_d": gains["spread_d"],
    }  # fmt: skip
    if CROSS in gains:
        outputs[CROSS] = gains[CROSS]
    after = {"x": now["x_next"], **gains, "started": 1}
    return m.recursion(name, data, next=after, outputs=outputs, channels=channels, dt=s.dt)


def _covariance_step(found: Forces, *, cross: bool) -> ca.Function:
    """``(P, mask, started)`` to the covariance of the next prediction and what holds for a sample.

    Gains ``L`` and ``M``, whether forces are ``unobserved``, and in physical units the lower
    triangles of the covariances of states, forces and innovation; with `cross` that of states and
    forces.
    """
    system, s, nx = found.system, found.system.s, found.system.s.model.nx
    kept = Covariance(nx)
    P, mask = ca.MX.sym("P", kept.size), ca.MX.sym("mask", s.model.ny)
    started, C = ca.MX.sym("started"), few_entries(system.C)
    PCt = times_transposed(kept.opened(P), C)
    now = named_results(many_weights(found), PCt, started, mask)
    joint = symmetric_part(congruence(now["T"], kept.opened(P), now["V"]))
    E = found.E if found.direct else np.zeros_like(found.E)
    ahead = congruence(few_entries(np.hstack([system.A, E])), joint, ca.DM(s.Q))
    results = {
        "P": kept.closed(ahead),
        "L": now["L"],
        "M": now["M"],
        "unobserved": now["unobserved"],
        "spread": triangle(joint[:nx, :nx], s.sx),
        "spread_d": triangle(joint[nx:, nx:], found.unit),
        "S": triangle(now["S"], s.sy),
    }
    if cross:
        results[CROSS] = found.cross()(joint[:nx, nx:])
    return ca.Function(
        "joint_input_covariance", [P, mask, started], list(results.values()),
        ["P_prior", "mask", "start"], list(results),
    )  # fmt: skip
