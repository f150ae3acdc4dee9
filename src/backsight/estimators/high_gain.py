r"""The high-gain observer with parameter adaptation, as functions that estimators put together.

Numbers are the equations of Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and
parameter estimation: a comparison to extended and unscented Kalman filter".
"""

import dataclasses

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.runge_kutta import TABLEAUS, Integrator
from backsight.errors import TuningError
from backsight.models.affine import AffineForm
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Gains:
    """Tuning of the observer.

    Parameters
    ----------
    k0 : (n,) array
        Makes A0 - k0 c0 stable.
    Gamma : (p, p) array
        Speed of adaptation, symmetric and positive definite; (0, 0) without parameters.
    consistent : bool
        Without the surplus lambda of the printed eq. 10.
    """

    k0: Array
    Gamma: Array
    consistent: bool = True


def gain_vector(poles: complex | tuple[complex, ...], n: int) -> Array:
    """k0 (n,) that places the eigenvalues of A0 - k0 c0.

    Parameters
    ----------
    poles : number or n numbers
        One number: n-fold. Complex ones in conjugate pairs; all with negative real part.
    """
    wanted = np.atleast_1d(np.asarray(poles, complex))
    if wanted.size == 1:
        wanted = np.repeat(wanted, n)
    if wanted.shape != (n,):
        raise TuningError(f"poles has {wanted.size} entries; the chain has {n} states")
    if not np.all(wanted.real < 0):
        raise TuningError(f"poles {wanted.tolist()} must all have a negative real part")
    polynomial = np.poly(wanted)
    if np.any(np.abs(np.imag(polynomial)) > 1e-9):
        raise TuningError(f"complex poles {wanted.tolist()} must come in conjugate pairs")
    return np.real(polynomial[1:]).astype(float)


def amplification(scheme: str, z: NDArray[np.complex128]) -> Array:
    """Largest factor by which a Runge-Kutta step multiplies exp(z t) over t = 1, per z."""
    tableau = TABLEAUS[scheme]
    stages = len(tableau.b)
    A = np.zeros((stages, stages))
    for i, row in enumerate(tableau.a):
        A[i, : len(row)] = row
    ones, b = np.ones(stages), np.array(tableau.b)
    return np.array([abs(1 + v * b @ np.linalg.solve(np.eye(stages) - v * A, ones)) for v in z])


def check_step(lam: float, k0: Array, integrator: Integrator, dt: float) -> None:
    """Raise `TuningError` if lambda is too large for the integration step."""
    n, h = len(k0), dt / integrator.substeps
    A = np.diag(np.ones(n - 1), 1)
    A[:, 0] -= k0
    growth = amplification(integrator.scheme, h * lam * np.linalg.eigvals(A).astype(complex))
    if growth.max() > 1:
        raise TuningError(
            f"lambda = {lam:g} is too large for steps of {h:g} s with '{integrator.scheme}': "
            f"lambda * h = {lam * h:.3g} is outside its stable range; use more substeps or a "
            "smaller lambda (0.3 or less is accurate)"
        )


def observer_rhs(form: AffineForm, gains: Gains) -> ca.Function:
    """Right-hand side of eq. 10 (eq. 5 without parameters).

    ``(x, theta, Upsilon, y, u, lam, on) -> (dx, dtheta, dUpsilon)``; with ``on = 0`` nothing was
    measured and the model runs free.
    """
    n, p = form.n, len(form.combinations)
    x, theta, Y = ca.SX.sym("x", n), ca.SX.sym("theta", p), ca.SX.sym("Y", n, p)
    y, lam, on = ca.SX.sym("y"), ca.SX.sym("lam"), ca.SX.sym("on")
    u = ca.SX.sym("u", form.phi.numel_in(1))
    psi = form.psi.call([x, u])[0]
    e = on * (y - x[0])

    shifted = ca.vertcat(x[1:], 0)
    last = ca.vertcat(ca.SX.zeros(n - 1), ca.dot(psi, theta) if p else 0)
    powers = ca.vertcat(*(lam**i for i in range(n)))
    adapt = ca.SX(gains.Gamma) @ Y[0, :].T if p else ca.SX(0, 1)
    surplus = 1 if gains.consistent else lam
    correction = powers * (lam * ca.SX(gains.k0) + surplus * (Y @ adapt if p else 0))
    dx = shifted + form.phi.call([x, u])[0] + last + correction * e
    dtheta = lam**n * adapt * e
    dY = lam * (ca.vertcat(Y[1:, :], ca.SX.zeros(1, p)) - ca.SX(gains.k0) @ Y[0, :])
    dY[n - 1, :] += lam * psi.T
    return ca.Function("observer_rhs", [x, theta, Y, y, u, lam, on], [dx, dtheta, dY])


def observer_step(
    form: AffineForm, gains: Gains, integrator: Integrator, *, h: float, density: float
) -> ca.Function:
    """One sub-step of observer and covariance.

    ``(x, theta, Upsilon, P, ua, ub, ya, yb, lam, on) -> (x, theta, Upsilon, P)`` with Upsilon
    flat and P as lower triangle. Inputs and measurement go linearly from a to b. The covariance is
    the one of the linearised error under measurement noise of spectral density `density` and an
    uncertain start: an observer promises no more.
    """
    n, p = form.n, len(form.combinations)
    rhs = observer_rhs(form, gains)
    z = ca.SX.sym("z", n + p + n * p)
    vP = ca.SX.sym("P", (n + p) * (n + p + 1) // 2)
    nu = form.phi.numel_in(1)
    ua, ub = ca.SX.sym("ua", nu), ca.SX.sym("ub", nu)
    ya, yb, lam, on = (ca.SX.sym(k) for k in ("ya", "yb", "lam", "on"))

    def flow(v: ca.SX, w: ca.SX) -> ca.SX:
        Y = ca.reshape(v[n + p :], n, p)
        dx, dtheta, dY = rhs.call([v[:n], v[n : n + p], Y, w[nu], w[:nu], lam, on])
        return ca.vertcat(dx, dtheta, ca.vec(dY))

    ramp = dataclasses.replace(integrator, hold="foh")
    z_next = ramp.substep(flow, z, ua=ca.vertcat(ua, ya), ub=ca.vertcat(ub, yb), h=h)
    slope = flow(z, ca.vertcat(ua, ya))[: n + p]
    A = ca.jacobian(slope, z[: n + p])
    K = ca.jacobian(slope, ya)
    Phi = ca.SX.eye(n + p) + h * A + h**2 / 2 * (A @ A)
    noise = density * h / 2 * (K @ K.T)
    P_next = Phi @ (unvech(vP) + noise) @ Phi.T + noise
    split = [z_next[:n], z_next[n : n + p], z_next[n + p :]]
    parts = [z[:n], z[n : n + p], z[n + p :]]
    symbols = [ca.SX.sym(k, m) for k, m in (("x", n), ("theta", p), ("Upsilon", n * p))]
    outputs = ca.substitute([*split, vech(P_next)], parts, symbols)
    return ca.Function("observer_step", [*symbols, vP, ua, ub, ya, yb, lam, on], [*outputs])
