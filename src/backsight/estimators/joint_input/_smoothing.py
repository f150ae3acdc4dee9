r"""The way back for states and forces of which nothing is known.

As in `backsight.estimators.smoothing.two_filter`, with the equations
:math:`U_k' (x_k - \hat x_k^-) = \zeta_k + \varepsilon_k`. Between the samples k and k + 1 the force
d acts; before it is known, the equations ahead and those of the outputs read

.. math::
    V_k' (A (x_k - \hat x_k^+) + E (d - \hat d)) = \zeta + \varepsilon, \qquad
    H' (x_k - \hat x_k^-) + F' d = e + \nu .

An orthogonal transformation that makes the rows of d triangular leaves equations without d: these
are all that is told of the state whatever the force, and go on back. A force that the measurements
do not determine has the prior that the filter gives it, which is one equation more for each.

The smoothed estimate is that of the filter, states and force together, with what is told from the
samples ahead.

Source: as in `two_filter`; the filter is that of Gillijns and De Moor (2007),
doi:10.1016/j.automatica.2006.08.002 and doi:10.1016/j.automatica.2006.11.016.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.symmetric import vech
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked, measured
from backsight.engine.recursion import Channel, ForwardBackward
from backsight.estimators.around.virtual import CROSS
from backsight.estimators.base import Spread
from backsight.estimators.joint_input._exact import exact_step, spread_of_prior
from backsight.estimators.joint_input._exact_smoothing import back_exactly, nothing_told
from backsight.estimators.joint_input._step import lost_forces, step
from backsight.estimators.joint_input._system import Forces
from backsight.estimators.kalman.exact_sensors import exact_sensors
from backsight.estimators.parts.covariance import Term, matrix_product, transposed
from backsight.estimators.parts.factors import cholesky, on_top
from backsight.estimators.parts.filtering import physical
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.linear import root, unstable
from backsight.estimators.parts.memory import Memory
from backsight.estimators.smoothing import (
    blurred,
    combined,
    filter_channels,
    gathered,
    leaving,
    smoothed_channels,
    weakened,
)
from backsight.types import Array


def joint_passes(name: str, found: Forces, *, covariance: Spread, cross: bool) -> ForwardBackward:
    """Pass forward and pass back of the joint input and state filter.

    With the channel `CROSS` if virtual outputs need it.
    """
    s, m = found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    data = {k: ca.MX.sym(k, n) for k, n in (("u", nu), ("y", ny), ("mask", ny))}
    exact = exact_sensors(s)
    memory = Memory(x=s.x0, P=spread_of_prior(s), started=0)
    go = exact_step(found) if exact else step(found)
    now = named_results(go, memory.x, memory.P, memory.started, *data.values())
    filtered = physical(
        s, x=now["x_post"], P=now["triangle"], u=now["v"], e=now["e"], S=now["spread"],
        flags=now["flags"],
    )  # fmt: skip
    handed = {"x_prior": now["prior"], "x_post": now["x_post"], "d": now["d_scaled"]}
    handed["joint"] = ca.vec(now["J"] if exact else now["joint"])  # a factor already, or none
    results = filter_channels(covariance)
    forward = memory.recursion(
        f"{name}_forward",
        list(data.values()),
        next={"x": now["x_next"], "P": now["P_next"], "started": 1},
        outputs=handed | {c.name: filtered[c.name] for c in results},
        channels=(*(Channel(k, ("entry",)) for k in handed), *results),
        dt=s.dt,
    )

    start = nothing_told(found) if exact else _nothing_told(found)
    back = Memory(**start)
    estimates = {k: ca.MX.sym(k, v.numel()) for k, v in handed.items()}
    u_next = ca.MX.sym("u_next", nu)
    joint = ca.reshape(estimates["joint"], nx + m, nx + m)
    smoothed = named_results(
        back_exactly(found) if exact else _back(found),
        *(getattr(back, k) for k in start),
        *(estimates[k] for k in ("x_prior", "x_post", "d")),
        joint if exact else _root(found)(joint),
        *data.values(),
    )
    both, Tt = smoothed["both"], smoothed["Tt"]
    d = both[nx:] * ca.DM(found.unit)
    inputs = ca.vertcat(data["u"] / s.su[:nu], d / s.su[nu:])
    outputs = leaving(s, covariance=covariance, rows=nx + m)(both[:nx], Tt[:, :nx], inputs)
    of_states, of_forces = smoothed_channels(covariance), _force_channels(found, covariance)
    values = [*outputs, d, _of_forces(found, covariance)(Tt[:, nx:])]
    channels = (*of_states, *of_forces)
    if cross:
        of_states_root, of_forces_root = ca.MX(Tt[:, :nx]), ca.MX(Tt[:, nx:])
        between = matrix_product(transposed(of_states_root), of_forces_root)
        values.append(found.cross()(between))
        channels = (*channels, Channel(CROSS, ("state", "force")))
    backward = back.recursion(
        f"{name}_backward",
        [*estimates.values(), data["u"], u_next, data["y"], data["mask"]],
        next={k: smoothed[k] for k in start},
        outputs={c.name: v for c, v in zip(channels, values, strict=True)},
        channels=channels,
        dt=s.dt,
    )
    return ForwardBackward(forward, backward)


def _nothing_told(found: Forces) -> dict[str, Array]:
    """What the way back begins with."""
    nx = found.system.s.model.nx
    return {"U": np.zeros((nx, nx)), "zeta": np.zeros(nx), "lost": np.ones(1)}


def _back(found: Forces) -> ca.Function:
    """One sample back: the information ahead, and states and forces together with their root."""
    system, s, m, direct = found.system, found.system.s, len(found.names), found.direct
    nx = s.model.nx
    A, E, G = ca.DM(system.A), ca.DM(found.E), ca.DM(root(s.Q))
    noise = blurred(G) if unstable(system.A) else G
    known = ca.DM(np.linalg.inv(np.linalg.cholesky(found.spread)).T)
    rows = _rows(found)
    sizes = {
        "U": (nx, nx), "zeta": nx, "lost": 1, "d": m, "L": (nx + m, nx + m), "u": found.nu,
        "Tt": (nx + m, nx + m),
    }  # fmt: skip

    def formula(
        U: Term, zeta: Term, lost: Term, x_prior: Term, x_post: Term, d: Term, L: Term,
        u: Term, y: Term, mask: Term,
    ) -> Results:  # fmt: skip
        Ct, Ft, e, lost_now = rows(x_prior, u, y, mask)
        # 1. What the samples ahead tell of A x + E d, and of each.
        V, told = weakened(U, zeta, type(U)(noise))
        of_x, of_d = matrix_product(V, A), matrix_product(V, E)
        prior = (lost_now if direct else lost) * type(U)(known)
        none = type(U).zeros
        joint = ca.vertcat(x_post, d)
        if direct:
            # 2. The smoothed estimate: state and force of this sample act ahead.
            both, Tt = combined(joint, L, ca.horzcat(of_x, of_d), told)
            # 3. With this sample's measurement, without the force.
            right = told + matrix_product(of_x, x_post - x_prior) + matrix_product(of_d, d)
            equations = [
                ca.horzcat(transposed(of_d), Ft, prior),
                ca.horzcat(transposed(of_x), Ct, none(nx, m)),
                ca.horzcat(transposed(right), transposed(e), none(1, m)),
            ]
            all_told = gathered(on_top(equations))
            U_next, zeta_next = all_told[m : m + nx, m : m + nx], all_told[m + nx, m : m + nx]
        else:
            # 2. The force that acts ahead is another one and unknown; then the estimate.
            equations = [
                ca.horzcat(transposed(of_d), prior),
                ca.horzcat(transposed(of_x), none(nx, m)),
                ca.horzcat(transposed(told), none(1, m)),
            ]
            ahead = gathered(on_top(equations))
            of_x, told = ahead[m : m + nx, m : m + nx], transposed(ahead[m + nx, m : m + nx])
            of_x = ca.densify(transposed(of_x))
            both, Tt = combined(joint, L, ca.horzcat(of_x, none(nx, m)), told)
            # 3. With this sample's measurement.
            right = told + matrix_product(of_x, x_post - x_prior)
            below = ca.horzcat(transposed(right), transposed(e))
            all_told = gathered(on_top([ca.horzcat(transposed(of_x), Ct), below]))
            U_next, zeta_next = all_told[:nx, :nx], all_told[nx, :nx]
        return {
            "U": ca.densify(U_next),
            "zeta": ca.densify(transposed(zeta_next)),
            "lost": lost_now,
            "both": both,
            "Tt": ca.densify(Tt),
        }

    return half("joint_smoothed_sample", s, formula, sizes)


def _rows(found: Forces) -> ca.Function:
    """Outputs with unit noise: ``(x_prior, u, y, mask) -> (C', F', e, lost)``.

    The residual is that of the prior without forces; lost says that they do not tell the forces.
    """
    system, s, nx = found.system, found.system.s, found.system.s.model.nx
    both, D = ca.SX(ca.DM(np.hstack([system.C, found.F]))), ca.DM(system.D[:, : found.nu])

    def formula(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        missed = y / s.sy - ca.DM(system.C) @ x - D @ (u / s.su[: found.nu])
        H, e, R = masked(both, missed, ca.SX(s.R), mask)
        L = cholesky_semidefinite(R)
        H = forward(L, H)
        lost = lost_forces(ca.diag(measured(mask)) @ ca.SX(found.H), found.H)
        return {
            "Ct": ca.densify(H[:, :nx].T),
            "Ft": ca.densify(H[:, nx:].T),
            "residual": forward(L, e),
            "lost": lost,
        }

    return leaf("joint_rows", {**notation(s), "u": found.nu}, formula)


def _root(found: Forces) -> ca.Function:
    """Lower factor of the covariance of states and forces."""
    n = found.system.s.model.nx + len(found.names)

    def formula(P_joint: Term) -> Results:
        return {"L": ca.densify(cholesky(P_joint))}

    return half("joint_root", found.system.s, formula, {"P_joint": (n, n), "L": (n, n)})


def _force_channels(found: Forces, covariance: Spread) -> tuple[Channel, Channel]:
    ago = 0 if found.direct else 1
    force = Channel("d_hat", ("force",), labels=found.names, ago=ago)
    if covariance == "std":
        return force, Channel("d_std", ("force",), labels=found.names)
    return force, Channel("P_d", ("force", "force_"), symmetric=True, labels=found.names)


def _of_forces(found: Forces, covariance: Spread) -> ca.Function:
    """Columns of the root to what is put out of the covariance of the forces, physical."""
    m = len(found.names)
    T = ca.SX.sym("T", found.system.s.model.nx + m, m)
    P = (T.T @ T) * ca.SX(np.outer(found.unit, found.unit))
    kept = vech(P) if covariance == "full" else ca.sqrt(ca.diag(P))
    return ca.Function("forces_spread", [T], [kept])
