"""Explicit Runge-Kutta methods as Butcher tableaus, with sub-steps and held or ramped input."""

import dataclasses
from collections.abc import Callable
from typing import Literal, TypeAlias

import casadi as ca

from backsight.description import Count, Description
from backsight.errors import TuningError


@dataclasses.dataclass(frozen=True)
class Tableau:
    """Coefficients of an explicit Runge-Kutta method.

    Parameters
    ----------
    a : rows of the strictly lower triangular stage matrix
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


RungeKutta: TypeAlias = Literal["euler", "heun", "rk4", "dopri5"]
"""Runge-Kutta methods, by their names in `TABLEAUS`."""

Scheme: TypeAlias = Literal["auto", "exact", "euler", "heun", "rk4", "dopri5"]
"""The methods, the matrix exponential, and what fits the model, see `backsight.discrete.steps`."""

Hold: TypeAlias = Literal["zoh", "foh"]
"""Between the samples: held, or a ramp to the next one."""

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
    scheme : {"auto", "exact", "euler", "heun", "rk4", "dopri5"}
        Runge-Kutta method, or ``exact``, the matrix exponential, for linear models. ``auto`` with
        given `substeps` is ``rk4``.
    substeps : int or "auto"
        Equal steps per sampling period; ``auto``: as many as are needed.
    hold : {"zoh", "foh"}
        Input between samples: held, or interpolated linearly to the next sample.

    Raises
    ------
    TuningError
        If the scheme or hold is unknown or `substeps` is neither a positive whole number nor
        "auto".
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
        slopes: list[ca.SX] = []
        for row, c in zip(tableau.a, tableau.c, strict=True):
            stage = x + h * weighted(row, slopes) if any(row) else x
            slopes.append(rhs(stage, ua if self.hold == "zoh" else ua + c * (ub - ua)))
        return x + h * weighted(tableau.b, slopes)


def weighted(weights: tuple[float, ...], terms: list[ca.SX]) -> ca.SX:
    """Sum of the terms with their weights, zero weights left out."""
    products = [w * t for w, t in zip(weights, terms, strict=False) if w]
    total = products[0]
    for product in products[1:]:
        total = total + product
    return total
