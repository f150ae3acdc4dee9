r"""The high-gain observer with parameter adaptation, as functions that estimators put together.

Numbers are the equations of Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and
parameter estimation: a comparison to extended and unscented Kalman filter".
"""

import dataclasses
from collections.abc import Callable
from typing import Literal, TypeAlias, cast

import casadi as ca
import numpy as np

from backsight.discrete.modes import Modes
from backsight.discrete.runge_kutta import Integrator, RungeKutta
from backsight.discrete.steps import explicit, stability
from backsight.errors import TuningError
from backsight.estimators.parts.leaf import Results, Size, Symmetric, leaf
from backsight.models.canonical.affine import AffineForm, Coordinates
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class ObserverGains:
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


def observer_modes(lam: float, k0: Array) -> Modes:
    """Modes of the observer's error, beside those of the model."""
    A = np.diag(np.ones(len(k0) - 1), 1)
    A[:, 0] -= k0
    values = (lam * np.linalg.eigvals(A)).astype(complex)
    return Modes(values, ("the observer",) * len(k0))


LEAST_STEPS = 2
"""Steps per sample that are taken at least: the covariance is integrated to second order only."""


def observer_steps(
    given: Integrator, modes: Callable[[], Modes], *, lam: float, k0: Array, dt: float
) -> Integrator:
    """Settle the integration step for the modes of the model and those of the observer.

    Raises
    ------
    TuningError
        If lambda is too large, above all for given steps, or the model too stiff.
    """
    own = observer_modes(lam, k0)
    try:
        explicit(given, lambda: own, dt=dt)
    except TuningError as error:
        raise TuningError(f"lambda = {lam:g} is too large: {error}") from None
    chosen = explicit(given, lambda: modes() + own, dt=dt)
    if given.substeps == "auto":
        chosen = dataclasses.replace(chosen, substeps=max(chosen.steps, LEAST_STEPS))
    check_step(lam, k0, chosen, dt)
    return chosen


def check_step(lam: float, k0: Array, integrator: Integrator, dt: float) -> None:
    """Raise `TuningError` if lambda is too large for the integration step."""
    h = dt / integrator.steps
    scheme = cast(RungeKutta, integrator.scheme)
    growth = np.abs(stability(scheme, h * observer_modes(lam, k0).values))
    if growth.max() > 1:
        raise TuningError(
            f"lambda = {lam:g} is too large for steps of {h:g} s with '{integrator.scheme}': "
            f"lambda * h = {lam * h:.3g} is outside its stable range; use more substeps or a "
            "smaller lambda (0.3 or less is accurate)"
        )


def observer_sizes(form: AffineForm) -> dict[str, Size]:
    """Sizes of the observer's symbols by name, see `leaf`; Upsilon travels flat."""
    n, p, nu = form.n, form.p, form.nu
    return {
        "x": n, "theta": p, "fixed": p, "Upsilon": n * p, "area": 1,
        "u": nu, "ua": nu, "ub": nu, "y": 1, "ya": 1, "yb": 1, "mask": 1, "ma": 1, "mb": 1,
        "lam": 1, "on": 1, "wa": 2, "wb": 2,
    }  # fmt: skip


def observer_rhs(form: AffineForm, gains: ObserverGains) -> ca.Function:
    """Right-hand side of eq. 10 (eq. 5 without parameters).

    ``(x, theta, Upsilon, y, u, lam, on) -> (dx, dtheta, dUpsilon)``; with ``on = 0`` nothing was
    measured and the model runs free.
    """
    n, p = form.n, form.p
    k0, Gamma = ca.SX(gains.k0), ca.SX(gains.Gamma)

    def formula(
        x: ca.SX, theta: ca.SX, Upsilon: ca.SX, y: ca.SX, u: ca.SX, lam: ca.SX, on: ca.SX
    ) -> Results:
        e = on * (y - x[0])
        powers = ca.vertcat(*(lam**i for i in range(n)))
        adapt = Gamma @ Upsilon[0, :].T if p else ca.SX(0, 1)
        surplus = 1 if gains.consistent else lam
        correction = powers * (lam * k0 + surplus * (Upsilon @ adapt if p else 0))
        # eq. 8
        dUpsilon = lam * (ca.vertcat(Upsilon[1:, :], ca.SX.zeros(1, p)) - k0 @ Upsilon[0, :])
        dUpsilon[n - 1, :] += lam * form.psi.call([x, u])[0].T
        return {
            "dx": form.rhs(x, theta, u) + correction * e,
            "dtheta": lam**n * adapt * e,
            "dUpsilon": dUpsilon,
        }

    return leaf("observer_rhs", {**observer_sizes(form), "Upsilon": (n, p)}, formula)


Interpolation: TypeAlias = Literal["model", "linear", "hold"]
"""The measurement between samples.

``model`` adds the linearly interpolated innovation to the model's prediction, so that a perfect
model leaves nothing to correct; ``linear`` joins the samples by straight lines; ``hold`` keeps the
last sample, which is a delay of half a sampling period.
"""


@dataclasses.dataclass(frozen=True)
class Spread:
    """What makes the error of an observer spread beside the measurement noise.

    Parameters
    ----------
    Q : (n + p + q, n + p + q) array
        What the random walks of chain, theta and constants that are not estimated add per sample.
    Qc : (n + p + q, n + p + q) array
        Spectral density of those that go on between the samples.
    constants : casadi.Function
        ``(x, u) -> (n, q)``: how those constants move the chain; not used without any.
    coordinates : Coordinates, optional
        Of a chain whose derivative by the states is not the same everywhere: `Q` is then that of
        the states.
    """

    Q: Array
    Qc: Array
    constants: ca.Function
    coordinates: Coordinates | None = None

    def slope(self, x: ca.SX) -> ca.SX:
        """Derivative of chain, theta and constants by the states, at the chain x."""
        T = ca.SX.eye(self.size)
        if self.coordinates is not None:
            states = self.coordinates.states.call([x])[0]
            T[: x.numel(), : x.numel()] = self.coordinates.slope.call([states])[0]
        return T

    @property
    def size(self) -> int:
        """n + p + q."""
        return len(self.Q)


def observer_step(
    form: AffineForm,
    gains: ObserverGains,
    integrator: Integrator,
    spread: Spread,
    *,
    h: float,
    interpolation: str,
) -> ca.Function:
    """One sub-step of observer and covariance.

    ``(x, theta, Upsilon, P, B, x_free, ua, ub, ya, yb, wa, wb, lam, on, fixed)`` to the first six,
    with Upsilon flat and P as lower triangle. Inputs go linearly from a to b, and so does y; with
    interpolation "model" it is the distance of the measurement from the model's prediction
    `x_free`, with the parameters `fixed`.

    P is the covariance of the linearised error without the noise of the two measurements at the
    ends of the sampling period: an observer promises no more. The columns of B (n + p, 2) are the
    influence of that noise; their weights in the measurement go linearly from wa to wb.
    """
    n, p = form.n, form.p
    rhs = observer_rhs(form, gains)
    parts = np.cumsum([0, n, p, n * p, n])
    interpolated = dataclasses.replace(integrator, hold="foh")

    def formula(
        x: ca.SX, theta: ca.SX, Upsilon: ca.SX, P: ca.SX, B: ca.SX, x_free: ca.SX,
        ua: ca.SX, ub: ca.SX, ya: ca.SX, yb: ca.SX, wa: ca.SX, wb: ca.SX,
        lam: ca.SX, on: ca.SX, fixed: ca.SX,
    ) -> Results:  # fmt: skip
        def flow(v: ca.SX, w: ca.SX) -> ca.SX:
            xi, th, Yi, free = ca.vertsplit(v, list(parts))
            y = w[-1] + free[0] if interpolation == "model" else w[-1]
            slopes = rhs.call([xi, th, ca.reshape(Yi, n, p), y, w[:-1], lam, on])
            return ca.vertcat(*map(ca.vec, slopes), form.rhs(free, fixed, w[:-1]))

        # 1. eq. 10, beside it the model alone
        z = ca.vertcat(x, theta, Upsilon, x_free)
        z_next = interpolated.substep(flow, z, ua=ca.vertcat(ua, ya), ub=ca.vertcat(ub, yb), h=h)
        x_next, theta_next, Upsilon_next, free_next = ca.vertsplit(z_next, list(parts))
        # 2. the linearised error: its covariance, and the influence of the noise at both ends
        slope = flow(z, ca.vertcat(ua, ya))[: n + p]
        A = ca.horzcat(ca.jacobian(slope, x), ca.jacobian(slope, theta))
        K = ca.jacobian(slope, ya)
        Phi, P_next = _propagated(P, A, spread, x, ua, h)
        B_next = Phi[: n + p, : n + p] @ B + h / 2 * K @ (wa + wb).T + h**2 / 2 * (A @ K) @ wa.T
        return {
            "x": x_next, "theta": theta_next, "Upsilon": Upsilon_next,
            "P": P_next, "B": B_next, "x_free": free_next,
        }  # fmt: skip

    sizes = {**observer_sizes(form), "P": Symmetric(spread.size), "B": (n + p, 2)}
    return leaf("observer_step", sizes, formula)


def free_step(form: AffineForm, integrator: Integrator, spread: Spread, *, h: float) -> ca.Function:
    """One sub-step of the model alone: ``(x, P, ua, ub, theta) -> (x, P)``."""
    interpolated = dataclasses.replace(integrator, hold="foh")

    def formula(x: ca.SX, P: ca.SX, ua: ca.SX, ub: ca.SX, theta: ca.SX) -> Results:
        x_next = interpolated.substep(lambda v, w: form.rhs(v, theta, w), x, ua=ua, ub=ub, h=h)
        slope = ca.vertcat(form.rhs(x, theta, ua), ca.SX.zeros(form.p))
        A = ca.horzcat(ca.jacobian(slope, x), ca.jacobian(slope, theta))
        _, P_next = _propagated(P, A, spread, x, ua, h)
        return {"x": x_next, "P": P_next}

    return leaf("free_step", {**observer_sizes(form), "P": Symmetric(spread.size)}, formula)


def _propagated(
    P: ca.SX, A: ca.SX, spread: Spread, x: ca.SX, u: ca.SX, h: float
) -> tuple[ca.SX, ca.SX]:
    """Transition matrix and covariance: second order in h, positive semidefinite for every h."""
    m, full = A.shape[0], ca.SX(spread.size, spread.size)
    full[:m, :m] = A
    if spread.size > m:
        full[: x.numel(), m:] = spread.constants.call([x, u])[0]
    Phi = ca.SX.eye(spread.size) + h * full + h**2 / 2 * (full @ full)
    half = ca.SX(ca.sparsify(ca.DM(h / 2 * spread.Qc)))
    if spread.coordinates is not None:
        T = spread.slope(x)
        half = T @ half @ T.T
    return Phi, Phi @ (P + half) @ Phi.T + half
