r"""Roots of equations in straight-line code: some Newton passes, and exact derivatives.

The passes find :math:`w^*`; what is put out is one pass more from there,

.. math:: w = w^* - \left(\frac{\partial g}{\partial w}\right)^{-1} g(w^*, x),

of which only g(., x) is differentiated by x: this is the implicit function theorem,
:math:`dw/dx = -(\partial g / \partial w)^{-1}\, \partial g / \partial x`. The passes before
carry no derivative, since their result goes through a rounding, whose derivative is zero (`held`);
the last pass, which converges quadratically, gives back the digits that this takes. So derivatives
cost one pass, whatever the number of passes, and a result behaves like any other expression.

Source: Griewank, Walther, "Evaluating Derivatives", 2008, doi:10.1137/1.9780898717761, chapter 15.
"""

import dataclasses
import math
from collections.abc import Callable

import casadi as ca

from backsight.algebra.degree import degrees

PASSES = 8
"""Newton passes before the last one."""

LENGTHS = (1.0, 0.5, 0.125)
"""Lengths of a step that are tried; the one that leaves the smallest residual is taken."""

KEPT = 30
"""Binary digits that `held` keeps."""

SOLVED = 1e-6
"""Residual that counts as none, by what its terms add up to."""


@dataclasses.dataclass(frozen=True)
class Root:
    """A root of equations.

    Parameters
    ----------
    w : SX
        The root, (n, 1).
    left : SX
        Residual before the last pass, as a share of what the equation's terms could add up to; the
        largest of all equations. It is solved if this is below `SOLVED`.
    """

    w: ca.SX
    left: ca.SX


def newton(residual: Callable[[ca.SX], ca.SX], guess: ca.SX, *, passes: int = PASSES) -> Root:
    """Solve g(w) = 0 from a guess; g may contain other symbols, by which the root has derivatives.

    Parameters
    ----------
    residual : callable
        w (n, 1) to g (n, 1).
    guess : SX
        (n, 1)
    passes : int
    """
    w = ca.SX.sym("w", guess.shape[0])
    g = ca.densify(residual(w))
    J = ca.jacobian(g, w)
    others = [s for s in ca.symvar(ca.veccat(g, J, guess)) if not _is_one_of(s, w)]
    at = ca.Function("at", [w, *others], [g, J])
    near = ca.Function("near", [w, *others], [_shorter(at, w, others, g, J)])
    if max(degrees(ca.Function("rows", [w, *others], [g]))) < 2:
        # One pass from anywhere is exact, and linear in what else g is linear in.
        nowhere = ca.SX.zeros(w.shape[0])
        g_there, J_there = at(nowhere, *others)
        return Root(w=-ca.solve(J_there, g_there), left=ca.SX(0))
    found = guess
    for _ in range(passes):
        found = near(found, *others)
    start = held(found)
    g_there, J_there = at(start, *others)
    return Root(
        w=start - ca.solve(J_there, g_there),
        left=_left(g_there, J_there, start, guess),
    )


def held(value: ca.SX) -> ca.SX:
    """The value to `KEPT` binary digits, as a constant for derivatives."""
    power = ca.floor(ca.log(ca.fabs(value) + 1e-200) / math.log(2))
    unit = ca.exp(math.log(2) * (power - KEPT))
    return ca.floor(value / unit + 0.5) * unit


def _shorter(at: ca.Function, w: ca.SX, others: list[ca.SX], g: ca.SX, J: ca.SX) -> ca.SX:
    """One pass, by the length that leaves least; each equation weighed by its terms."""
    step = -ca.solve(J, g)
    weight = ca.fabs(J) @ (ca.fabs(w) + ca.fabs(step)) + 1e-300
    best, least = w + LENGTHS[0] * step, None
    for length in LENGTHS:
        tried = w + length * step
        size = ca.sumsqr(at(tried, *others)[0] / weight)
        if least is None:
            least = size
            continue
        better = size < least
        best, least = ca.if_else(better, tried, best), ca.if_else(better, size, least)
    return best


def _left(g: ca.SX, J: ca.SX, w: ca.SX, guess: ca.SX) -> ca.SX:
    terms = ca.fabs(J) @ (ca.fabs(w) + ca.fabs(w - guess)) + 1e-300
    return ca.mmax(ca.fabs(g) / terms)


def _is_one_of(symbol: ca.SX, vector: ca.SX) -> bool:
    return any(ca.is_equal(symbol, entry, 0) for entry in ca.vertsplit(vector))
