"""Runge-Kutta methods as Butcher tableaus, with sub-steps and held or ramped input.

The implicit ones are for stiff models: their stages are solved by Newton's method, a fixed number
of passes in straight-line code with exact derivatives, see `backsight.algebra.newton`.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import casadi as ca

from backsight.algebra.newton import newton
from backsight.description import Count, Description
from backsight.errors import TuningError


@dataclasses.dataclass(frozen=True)
class Tableau:
    """Coefficients of a Runge-Kutta method.

    Parameters
    ----------
    a : rows of the stage matrix; of an explicit method what is left of the diagonal
    b : weights
    order : order of convergence
    """

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    order: int

    @property
    def c(self) -> tuple[float, ...]:
        """Stage times as fractions of the step."""
        return tuple(sum(row) for row in self.a)

    @property
    def a_square(self) -> tuple[tuple[float, ...], ...]:
        """All of the stage matrix."""
        return tuple((*row, *[0.0] * (len(self.b) - len(row))) for row in self.a)

    @property
    def implicit(self) -> bool:
        """Whether a stage depends on itself or on later ones."""
        return any(len(row) > i and any(row[i:]) for i, row in enumerate(self.a))

    @property
    def one_by_one(self) -> bool:
        """Whether no stage depends on later ones."""
        return not any(any(row[i + 1 :]) for i, row in enumerate(self.a))


RungeKutta: TypeAlias = Literal[
    "euler", "heun", "rk4", "dopri5", "implicit_midpoint", "sdirk", "radau"
]
"""Runge-Kutta methods, by their names in `TABLEAUS`."""

Scheme: TypeAlias = Literal[
    "auto", "exact", "euler", "heun", "rk4", "dopri5", "implicit_midpoint", "sdirk", "radau"
]
"""The methods, the matrix exponential, and what fits the model, see `backsight.discrete.steps`."""

Hold: TypeAlias = Literal["zoh", "foh"]
"""Between the samples: held, or a ramp to the next one."""

_G = 0.4358665215084590
"""Root of g**3 - 3 g**2 + 3/2 g - 1/6 for which the method of Alexander is L-stable."""

TABLEAUS: dict[RungeKutta, Tableau] = {
    "euler": Tableau(a=((),), b=(1.0,), order=1),
    "heun": Tableau(a=((), (1.0,)), b=(0.5, 0.5), order=2),
    "rk4": Tableau(
        a=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), b=(1 / 6, 1 / 3, 1 / 3, 1 / 6), order=4
    ),
    # The fifth-order solution of Dormand and Prince (1980), doi:10.1016/0771-050X(80)90013-3.
    "dopri5": Tableau(
        a=(
            (),
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        b=(35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
        order=5,
    ),
    "implicit_midpoint": Tableau(a=((0.5,),), b=(1.0,), order=2),
    # Alexander (1977), "Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s",
    # doi:10.1137/0714068: stage by stage.
    "sdirk": Tableau(
        a=(
            (_G,),
            ((1 - _G) / 2, _G),
            (-(6 * _G**2 - 16 * _G + 1) / 4, (6 * _G**2 - 20 * _G + 5) / 4, _G),
        ),
        b=(-(6 * _G**2 - 16 * _G + 1) / 4, (6 * _G**2 - 20 * _G + 5) / 4, _G),
        order=3,
    ),
    # Radau IIA: Hairer, Wanner (1996), table IV.5.5, doi:10.1007/978-3-642-05221-7.
    "radau": Tableau(a=((5 / 12, -1 / 12), (3 / 4, 1 / 4)), b=(3 / 4, 1 / 4), order=3),
}
"""Heun is eq. 33-34 of Polóni et al. (2012)."""


@dataclasses.dataclass(frozen=True)
class Integrator(Description):
    """How a continuous-time model is carried over one sampling period.

    Left to itself it chooses when it meets the model, see `backsight.discrete.steps.choose`: the
    matrix exponential where the model is linear between the samples, else the cheaper one of
    ``rk4`` and ``dopri5`` with as many steps as the modes of the model need.

    Parameters
    ----------
    scheme : str
        Runge-Kutta method (``euler``, ``heun``, ``rk4``, ``dopri5``; implicit for stiff models
        ``implicit_midpoint``, ``sdirk``, ``radau``), or ``exact``, the matrix exponential, for
        linear models. ``auto`` with given `substeps` is ``rk4``; it takes no implicit one.
    substeps : int or "auto"
        Equal steps per sampling period; ``auto``: as many as are needed.
    hold : {"zoh", "foh"}
        Input between samples: held, or interpolated linearly to the next sample.

    Raises
    ------
    TuningError
        If the scheme or hold is unknown or `substeps` is neither a positive whole number nor
        "auto".

    Examples
    --------
    >>> bs.Integrator()  # chooses scheme and steps by the modes of the model
    Integrator(scheme='auto', substeps='auto', hold='zoh')
    >>> bs.Integrator("rk4", substeps=4).substeps
    4
    """

    scheme: Scheme = "auto"
    substeps: Count | Literal["auto"] = "auto"
    hold: Hold = "zoh"

    @property
    def steps(self) -> int:
        """Steps per sampling period of a choice that has been made.

        Raises
        ------
        TuningError
            If it has not.
        """
        if self.substeps == "auto":
            raise TuningError("the sub-steps are 'auto': they are known with a model only")
        return int(self.substeps)

    def substep(
        self,
        rhs: Callable[[ca.SX, ca.SX], ca.SX],
        x: ca.SX,
        *,
        ua: ca.SX,
        ub: ca.SX,
        h: float | ca.SX,
    ) -> ca.SX:
        """Advance x' = rhs(x, u) by one sub-step of length h; u goes from `ua` to `ub`.

        Raises
        ------
        TuningError
            If the scheme is no Runge-Kutta method; see `backsight.discrete.steps.advanced`.
        """
        if self.scheme in ("auto", "exact"):
            raise TuningError(f"scheme '{self.scheme}' is no Runge-Kutta method")
        tableau = TABLEAUS[self.scheme]
        inputs = [ua if self.hold == "zoh" else ua + c * (ub - ua) for c in tableau.c]
        if tableau.implicit:
            return implicit_step(tableau, rhs, x, inputs=inputs, h=h).x
        slopes: list[ca.SX] = []
        for row, v in zip(tableau.a, inputs, strict=True):
            stage = x + h * weighted(row, slopes) if any(row) else x
            slopes.append(rhs(stage, v))
        return x + h * weighted(tableau.b, slopes)

    def left(
        self, rhs: Callable[[ca.SX, ca.SX], ca.SX], x: ca.SX, *, u: ca.SX, h: float | ca.SX
    ) -> ca.SX:
        """What the equations of a sub-step leave, see `backsight.algebra.newton.Root`."""
        if self.scheme in ("auto", "exact") or not TABLEAUS[self.scheme].implicit:
            return ca.SX(0)
        tableau = TABLEAUS[self.scheme]
        return implicit_step(tableau, rhs, x, inputs=[u] * len(tableau.b), h=h).left


@dataclasses.dataclass(frozen=True)
class ImplicitStep:
    """State after a step, and what its equations leave, see `backsight.algebra.newton.Root`."""

    x: ca.SX
    left: ca.SX


def implicit_step(
    tableau: Tableau,
    rhs: Callable[[ca.SX, ca.SX], ca.SX],
    x: ca.SX,
    *,
    inputs: Sequence[ca.SX],
    h: float | ca.SX,
) -> ImplicitStep:
    """One step of an implicit method; unknown are the states of its stages.

    Those that do not move by themselves (parameters) are no unknowns.
    """
    moving = [i for i in range(x.shape[0]) if not ca.SX(rhs(x, inputs[0]))[i].is_zero()]
    n, s = len(moving), len(tableau.b)
    if not n:
        return ImplicitStep(x, ca.SX(0))

    def whole(part: ca.SX) -> ca.SX:
        return ca.vertcat(
            *(part[moving.index(i)] if i in moving else x[i] for i in range(x.shape[0]))
        )

    def rates(part: ca.SX, u: ca.SX) -> ca.SX:
        return ca.densify(ca.SX(rhs(whole(part), u))[moving])

    start = x[moving]
    if tableau.one_by_one:
        stages, slopes, left = [], [], ca.SX(0)
        for row, u in zip(tableau.a, inputs, strict=True):
            known = start + h * weighted(row[:-1], slopes) if slopes else start
            g = row[len(slopes)]
            root = newton(lambda w, u=u, k=known, g=g: w - k - h * g * rates(w, u), start)
            stages.append(root.w)
            # Not by the rates, which would make much of the little that the equations leave.
            slopes.append((root.w - known) / (h * g))
            left = ca.fmax(left, root.left)
    else:

        def equations(w: ca.SX) -> ca.SX:
            parts = ca.vertsplit(w, n)
            found = [rates(p, u) for p, u in zip(parts, inputs, strict=True)]
            return ca.vertcat(
                *(p - start - h * weighted(row, found)
                  for p, row in zip(parts, tableau.a, strict=True))
            )  # fmt: skip

        root = newton(equations, ca.repmat(start, s, 1))
        stages, slopes, left = ca.vertsplit(root.w, n), [], root.left
    if tableau.a[-1] == tableau.b:
        return ImplicitStep(whole(stages[-1]), left)
    return ImplicitStep(whole(start + h * weighted(tableau.b, slopes)), left)


def weighted(weights: tuple[float, ...], terms: list[ca.SX]) -> ca.SX:
    """Sum of the terms with their weights, zero weights left out."""
    products = [w * t for w, t in zip(weights, terms, strict=False) if w]
    total = products[0]
    for product in products[1:]:
        total = total + product
    return total
