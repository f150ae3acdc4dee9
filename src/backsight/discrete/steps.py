r"""How a model goes over a sampling period, how many steps that needs, and what too few lose.

A mode of the linearised model with the eigenvalue :math:`\lambda` goes over a sampling period by
:math:`e^{\lambda\,dt}`. A method with the stability function R and n steps makes
:math:`R(\lambda\,dt / n)^n` of it. The difference is judged: it is the error of amplitude and phase
of every mode, relative to the mode's own size, and a method that is unstable for a mode that decays
cannot pass. Source: Hairer, Wanner, "Solving Ordinary Differential Equations II", 1996, section
IV.2, doi:10.1007/978-3-642-05221-7.
"""

import dataclasses
from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.discrete.exact import foh, zoh
from backsight.discrete.modes import Modes
from backsight.discrete.runge_kutta import TABLEAUS, Integrator, RungeKutta
from backsight.errors import TuningError
from backsight.models.lti import state_equation
from backsight.models.model import Model
from backsight.rounding import significant

ACCURATE = 1e-5
"""Error of a mode over one sampling period that is aimed at: a filter that remembers a thousand
samples is then wrong by a hundredth of what the mode does."""

COARSE = 2e-3
"""Error of a mode over one sampling period from which a choice is called too coarse."""

MOST_STEPS = 400
"""Steps per sampling period beyond which an explicit method is not the right one."""

CANDIDATES: tuple[RungeKutta, ...] = ("rk4", "dopri5")
"""Methods among which the cheapest is taken."""


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """What a method with n steps loses of the modes of a model over one sampling period.

    Parameters
    ----------
    error : float
        Largest error of a mode, relative to its size.
    mode : str
        The mode in words, with its eigenvalue.
    stable : bool
        Whether every mode that decays also decays in the method.
    """

    error: float = 0.0
    mode: str = ""
    stable: bool = True

    @property
    def coarse(self) -> bool:
        """Whether results cannot be trusted for that reason."""
        return not self.stable or self.error > COARSE

    @property
    def fine(self) -> bool:
        """Whether it is as accurate as it shall be."""
        return self.stable and self.error <= ACCURATE


def stability(scheme: RungeKutta, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    r"""Stability function :math:`R(z) = 1 + z\,b'(I - z A)^{-1} 1` of a method at every z."""
    tableau = TABLEAUS[scheme]
    if tableau.implicit:
        A, b = np.array(tableau.a_square), np.array(tableau.b)
        stages = np.linalg.solve(np.eye(len(b)) - z[..., None, None] * A, np.ones((len(b), 1)))
        return 1 + z * (b @ stages)[..., 0]
    slopes: list[NDArray[np.complex128]] = []
    # The stages of an explicit method are polynomials in z: no solve is needed.
    for row in tableau.a:
        slopes.append(1 + z * sum((a * k for a, k in zip(row, slopes, strict=False)), 0 * z))
    return 1 + z * sum((b * k for b, k in zip(tableau.b, slopes, strict=True)), 0 * z)


def accuracy(scheme: RungeKutta, modes: Modes, *, dt: float, steps: int) -> Accuracy:
    """What a method with so many steps per period loses of modes."""
    if not modes.values.size:
        return Accuracy()
    z = modes.values * dt
    with np.errstate(over="ignore", invalid="ignore"):
        R = stability(scheme, z / steps)
        true = np.exp(z)
        error = np.abs(R**steps - true) / np.maximum(np.abs(true), 1.0)
    error = np.where(np.isfinite(error), error, np.inf)
    worst = int(np.argmax(error))
    grows = np.abs(R[z.real <= 0]) > 1 + 1e-9
    # What grows by less than is aimed at in a period (an undamped mode) counts as stable.
    stable = not grows.any() or float(error[worst]) <= ACCURATE
    return Accuracy(error=float(error[worst]), mode=modes.told(worst), stable=stable)


def steps_needed(scheme: RungeKutta, modes: Modes, *, dt: float) -> int | None:
    """Least number of steps per period that loses no more than `ACCURATE` of any mode.

    None if that would be more than `MOST_STEPS`.
    """
    tried = range(1, MOST_STEPS + 1)
    return next((n for n in tried if accuracy(scheme, modes, dt=dt, steps=n).fine), None)


def settle_steps(
    given: Integrator, model: Model, modes: Callable[[], Modes], *, dt: float
) -> Integrator:
    """Settle what a description leaves open.

    Parameters
    ----------
    given : Integrator
    model : Model
    modes : callable
        Gives what has to be carried over; not asked where it does not matter.
    dt : float
        Sampling period [s].

    Returns
    -------
    Integrator
        With a method and a number of steps; of a discrete-time model as of a linear one.

    Raises
    ------
    TuningError
        If ``exact`` is asked for and the model is not linear, or no explicit method with at most
        `MOST_STEPS` steps is accurate.
    """
    linear = not model.continuous or state_equation(model) is not None
    scheme, steps = given.scheme, given.substeps
    if scheme == "exact" or (linear and scheme == "auto" and steps == "auto"):
        if not linear:
            raise TuningError(
                f"scheme 'exact' is for linear models; model '{model.name}' is not: use 'auto'"
            )
        return dataclasses.replace(given, scheme="exact", substeps=1 if steps == "auto" else steps)
    return explicit(given, modes, dt=dt)


def explicit(given: Integrator, modes: Callable[[], Modes], *, dt: float) -> Integrator:
    """Settle what a description leaves open, by a Runge-Kutta method; see `choose`."""
    if given.scheme == "exact":
        raise TuningError("scheme 'exact' is for models that are linear between samples")
    if given.substeps != "auto":
        return dataclasses.replace(given, scheme="rk4" if given.scheme == "auto" else given.scheme)
    schemes: tuple[RungeKutta, ...] = CANDIDATES if given.scheme == "auto" else (given.scheme,)
    there = modes()
    found: list[tuple[int, RungeKutta]] = [
        (n, s) for s in schemes if (n := steps_needed(s, there, dt=dt)) is not None
    ]
    if not found:
        tried = " or ".join(f"'{s}'" for s in schemes)
        lost = accuracy(schemes[-1], there, dt=dt, steps=MOST_STEPS)
        raise TuningError(
            f"{MOST_STEPS} steps of {tried} per sample of {dt:g} s do not carry {lost.mode} over "
            "it: take an implicit method, scheme = 'radau' or 'sdirk', take out what is so fast (a "
            "contact, friction, an electrical state), give the prior a narrower range, record "
            "faster, or fix the choice with Integrator(scheme, substeps)"
        )
    n, scheme = min(found, key=lambda k: k[0] * len(TABLEAUS[k[1]].b))
    return dataclasses.replace(given, scheme=scheme, substeps=n)


def complaint(chosen: Integrator, modes: Callable[[], Modes], *, dt: float) -> str:
    """Say that a choice is too coarse for modes, and what would do; empty if it is not."""
    if chosen.scheme in ("auto", "exact"):
        return ""
    there = modes()
    found = accuracy(chosen.scheme, there, dt=dt, steps=chosen.steps)
    if not found.coarse:
        return ""
    if found.stable:
        lost = f"is wrong by {significant(100 * found.error, 2)} % per sample for {found.mode}"
    else:
        lost = f"is unstable for {found.mode}"
    needed = steps_needed(chosen.scheme, there, dt=dt)
    remedy = f"substeps = {needed} or 'auto'" if needed else "scheme and substeps 'auto'"
    many = f"{chosen.steps} step{'s' if chosen.steps > 1 else ''}"
    return (
        f"the integration step, {chosen.scheme} with {many} per sample of {dt:g} s, {lost}; "
        f"use {remedy}"
    )


def in_words(chosen: Integrator) -> str:
    """The choice in words."""
    hold = "held" if chosen.hold == "zoh" else "interpolated"
    if chosen.scheme == "exact":
        return f"matrix exponential, inputs {hold}"
    return f"{chosen.scheme}, {chosen.steps} per sample, inputs {hold}"


def advanced(
    chosen: Integrator, model: Model, x: ca.SX, *, ua: ca.SX, ub: ca.SX, h: float
) -> ca.SX:
    """State of a continuous model a sub-step of length h later; u goes from `ua` to `ub`.

    Runge-Kutta, or, for a linear model, the matrix exponential: its Jacobian is then constant.
    """
    if chosen.scheme != "exact":
        return chosen.substep(model.rhs, x, ua=ua, ub=ub, h=h)
    found = state_equation(model)
    if found is None:
        raise TuningError(f"scheme 'exact' is for linear models; model '{model.name}' is not")
    A, B, c = found
    # The constant is an input of one.
    inputs = np.hstack([B, c[:, None]])
    one = ca.SX(1)
    if chosen.hold == "zoh":
        Ad, held = zoh(A, inputs, dt=h)
        terms = [(Ad, x), (held, ca.vertcat(ua, one))]
    else:
        Ad, first, last = foh(A, inputs, dt=h)
        terms = [(Ad, x), (first, ca.vertcat(ua, one)), (last, ca.vertcat(ub, one))]
    moved = sum((ca.sparsify(ca.DM(m)) @ v for m, v in terms), ca.SX(model.nx, 1))
    moves = np.abs(np.hstack([A, inputs])).sum(axis=1) > 0
    # What does not move (a parameter) stays as it is to the last bit.
    return ca.vertcat(*(moved[i] if moves[i] else x[i] for i in range(model.nx)))


def over_sample(chosen: Integrator, model: Model, dt: float) -> ca.Function:
    """State a sample later with its derivatives: ``(x, u, u_next) -> (x_next, F, G)``.

    G is the derivative by inputs that are held. Of discrete models, too.
    """
    size = model.nx, model.nu
    x, ua, ub = ca.SX.sym("x", size[0]), ca.SX.sym("ua", size[1]), ca.SX.sym("ub", size[1])
    n = chosen.steps if model.continuous else 1
    moved = model.rhs(x, ua)
    if model.continuous:
        moved = advanced(chosen, model, x, ua=ua, ub=ub, h=dt / n)
    by_u = ca.jacobian(moved, ua) + ca.jacobian(moved, ub)
    slopes = [ca.densify(ca.jacobian(moved, x)), ca.densify(by_u)]
    # One sub-step is differentiated once; the chain rule joins them.
    step = ca.Function("substep", [x, ua, ub], [moved, *slopes])
    start, u, v = (ca.MX.sym(k, s) for k, s in (("x", size[0]), ("u", size[1]), ("v", size[1])))
    end, F, G = start, ca.MX.eye(size[0]), ca.MX.zeros(*size)
    ramp = chosen.hold == "foh" and model.continuous
    for i in range(n):
        ends = (u + i / n * (v - u), u + (i + 1) / n * (v - u)) if ramp else (u, u)
        end, Phi, Gamma = step(end, *ends)
        F, G = Phi @ F, Phi @ G + Gamma
    return ca.Function("over_sample", [start, u, v], [end, ca.densify(F), G])
