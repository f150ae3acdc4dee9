r"""A recording of a model as a linear motion that changes from sample to sample.

.. math:: x_{k+1} = A_k x_k + b_k + E_k d_k + w_k, \qquad y_k = C_k x_k + c_k + F_k d_k + v_k

Of a linear model the matrices are always the same and b, c what the known inputs do; of a nonlinear
one they are those of its equations linearised along a motion (Gauss-Newton).
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.discrete.steps import over_sample
from backsight.estimators.force_estimator import Forced
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class MatricesInTime:
    """Matrices of every sample, scaled; forces in their own unit.

    Parameters
    ----------
    A, E, C, F : (n, nx, nx), (n, nx, nf), (n, ny, nx), (n, ny, nf) arrays
    moves, seen : (n, nx), (n, ny) arrays
        b and c.
    """

    A: Array
    E: Array
    C: Array
    F: Array
    moves: Array
    seen: Array


def linear_matrices(forced: Forced, u: Array) -> MatricesInTime:
    """Of a linear model with known inputs u (n, nu), scaled."""
    system, nu, n = forced.system, forced.nu, len(u)
    after = np.vstack([u[1:], np.zeros((1, nu))])
    return MatricesInTime(
        *(np.broadcast_to(m, (n, *m.shape)) for m in (system.A, forced.E, system.C, forced.F)),
        moves=u @ system.B[:, :nu].T + after @ system.B_next[:, :nu].T,
        seen=u @ system.D[:, :nu].T,
    )


def free_motion(forced: Forced, u: Array) -> Array:
    """States (n, nx) of a nonlinear model from the prior's mean, without forces."""
    s, d = forced.system.s, np.zeros(len(forced.names))
    step = over_sample(s.integrator, s.model, s.dt)
    x = [s.x0]
    for now in u[:-1]:
        both = np.concatenate([now, d])
        x.append(np.array(step(x[-1], both, both)[0]).ravel())
    return np.array(x)


def matrices_along(forced: Forced, x: Array, u: Array, d: Array) -> MatricesInTime:
    """Of a nonlinear model along states (n, nx), known inputs (n, nu) and forces (n, nf)."""
    s, nu, n = forced.system.s, forced.nu, len(x)
    unit = s.su[nu:]
    v = np.hstack([u, d / unit]).T
    step = over_sample(s.integrator, s.model, s.dt).map(n)
    after, A, B = (np.array(found) for found in step(x.T, v, v))
    state, given = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    y = s.model.output(state, given)
    slopes = [ca.densify(ca.jacobian(y, z)) for z in (state, given)]
    look = ca.Function("look", [state, given], [ca.densify(y), *slopes]).map(n)
    shown, C, D = (np.array(found) for found in look(x.T, v))
    A, B, C, D = (_apart(m, n) for m in (A, B, C, D))
    E, F = B[:, :, nu:] / unit, D[:, :, nu:] / unit
    moves = after.T - np.einsum("kij,kj->ki", A, x) - np.einsum("kij,kj->ki", E, d)
    seen = shown.T - np.einsum("kij,kj->ki", C, x) - np.einsum("kij,kj->ki", F, d)
    return MatricesInTime(A, E, C, F, moves, seen)


def _apart(side_by_side: Array, n: int) -> Array:
    """Matrices (n, rows, columns) that lie beside each other."""
    return side_by_side.reshape(len(side_by_side), n, -1).transpose(1, 0, 2)
