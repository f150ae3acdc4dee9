"""The way back of `_smoothing` with sensors that have no noise: by equations, some without noise.

As in `backsight.estimators.smoothing._equations`, with the force that acts between two samples as
in `backsight.estimators.joint_input._smoothing`: an orthogonal transformation of the rows leaves
what they tell of the state whatever the force.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.update import masked, measured
from backsight.estimators.joint_input._step import lost_forces
from backsight.estimators.joint_input._system import Forces, comparable
from backsight.estimators.parts.covariance import Term, matrix_product
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import root, unstable
from backsight.estimators.smoothing import (
    FlatForce,
    blurred,
    estimated,
    joined,
    joined_with_force,
    through_noise,
    without_force,
)
from backsight.types import Array


def nothing_told(found: Forces) -> dict[str, Array]:
    """What the way back begins with."""
    nx = found.system.s.model.nx
    return {"A": np.zeros((nx, nx)), "N": np.eye(nx), "zeta": np.zeros(nx), "lost": np.ones(1)}


def back_exactly(found: Forces) -> ca.Function:
    """One sample back, as `_smoothing`: states and forces together with their root.

    ``(A, N, zeta, lost, x_prior, x_post, d, J, u, y, mask)``
    """
    system, s, m, direct = found.system, found.system.s, len(found.names), found.direct
    nx = s.model.nx
    F, E, G = ca.DM(system.A), ca.DM(found.E), ca.DM(root(s.Q))
    drive = blurred(G) if unstable(system.A) else G
    known = ca.DM(np.linalg.inv(np.linalg.cholesky(found.spread)))
    rows = _rows(found)
    sizes = {
        "A": (nx, nx), "N": (nx, nx), "zeta": nx, "lost": 1, "d": m, "J": (nx + m, nx + m),
        "u": found.nu, "Tt": (nx + m, nx + m),
    }  # fmt: skip

    def formula(
        A: Term, N: Term, zeta: Term, lost: Term, x_prior: Term, x_post: Term, d: Term, J: Term,
        u: Term, y: Term, mask: Term,
    ) -> Results:  # fmt: skip
        kind = type(A)
        C, shown, e, noise, lost_now = rows(x_prior, u, y, mask)
        # 1. What the samples ahead tell of F x + E d.
        N = through_noise(A, N, kind(drive))
        of_x, of_d = matrix_product(A, kind(F)), matrix_product(A, kind(E))
        prior = (lost_now if direct else lost) * kind(known)
        state = ca.vertcat(x_post, d)
        if direct:
            # 2. The smoothed estimate: state and force of this sample act ahead.
            both, Tt = estimated(state, J, ca.horzcat(of_x, of_d), N, zeta)
            # 3. With this sample's measurement, whatever the force.
            zeta += matrix_product(of_x, x_post - x_prior) + matrix_product(of_d, d)
            force = FlatForce(E=of_d, F=shown, prior=prior)
            A, N, zeta = joined_with_force(of_x, N, zeta, H=C, noise=noise, e=e, d=force)
        else:
            # 2. The force that acts ahead is another one and unknown; then the estimate.
            A, N, zeta = without_force(of_x, N, zeta, E=of_d, prior=prior)
            both, Tt = estimated(state, J, ca.horzcat(A, kind.zeros(nx, m)), N, zeta)
            # 3. With this sample's measurement.
            zeta = zeta + matrix_product(A, x_post - x_prior)
            A, N, zeta = joined(A, N, zeta, H=C, noise=noise, e=e)
        return {"A": A, "N": N, "zeta": zeta, "lost": lost_now, "both": both, "Tt": Tt}

    return half("joint_smoothed_exactly", s, formula, sizes)


def _rows(found: Forces) -> ca.Function:
    """Outputs at the prior without forces: ``(x_prior, u, y, mask) -> (C, F, e, noise, lost)``."""
    system, s, nx = found.system, found.system.s, found.system.s.model.nx
    both, D = ca.SX(ca.DM(np.hstack([system.C, found.F]))), ca.DM(system.D[:, : found.nu])
    weights, complete = comparable(found)

    def formula(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        missed = y / s.sy - ca.DM(system.C) @ x - D @ (u / s.su[: found.nu])
        H, e, R = masked(both, missed, ca.SX(s.R), mask)
        shown = ca.diag(measured(mask)) @ ca.SX(weights * found.H)
        return {
            "C": ca.densify(H[:, :nx]),
            "F_shown": ca.densify(H[:, nx:]),
            "residual": e,
            "noise": ca.densify(cholesky_semidefinite(R)),
            "lost": lost_forces(shown, complete),
        }

    sizes = {**notation(s), "u": found.nu, "F_shown": (s.model.ny, len(found.names))}
    return leaf("joint_rows_back", sizes, formula)
