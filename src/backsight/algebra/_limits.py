"""Expressions that have a limit where CasADi has none: norms at zero, quotients of two zeros."""

import casadi as ca
import numpy as np


def root_of(z: ca.SX) -> ca.SX:
    """sqrt(z); of a sum of squares its slope at zero, which has no direction, is 0."""
    if not _is_sum_of_squares(z):
        return ca.sqrt(z)
    nothing = z == 0
    return ca.if_else(nothing, 0, ca.sqrt(ca.if_else(nothing, 1, z)))


def hypotenuse(a: ca.SX, b: ca.SX) -> ca.SX:
    """hypot(a, b), with a slope of 0 where both are zero."""
    nothing = ca.logic_and(a == 0, b == 0)
    return ca.if_else(nothing, 0, ca.hypot(ca.if_else(nothing, 1, a), b))


def quotient(a: ca.SX, b: ca.SX) -> ca.SX:
    """a / b; where b is a name and a is zero with it, as in sin(x) / x, the limit and its slope.

    At b = 0 the first terms of the series of a, divided by b.
    """
    if not b.is_symbolic() or not ca.depends_on(a, b) or not _at_zero(a, b).is_zero():
        return a / b
    slopes = [a]
    for _ in range(3):
        slopes.append(ca.jacobian(slopes[-1], b))
    first, second, third = (_at_zero(s, b) for s in slopes[1:])
    if any(s.is_constant() and not np.isfinite(float(s)) for s in (first, second, third)):
        return a / b
    series = first + second / 2 * b + third / 6 * b**2
    return ca.if_else(b == 0, series, a / ca.if_else(b == 0, 1, b))


def _at_zero(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.densify(ca.substitute(a, b, ca.SX(0)))


def _is_sum_of_squares(z: ca.SX) -> bool:
    if z.is_constant():
        return float(z) == 0
    if z.op() == ca.OP_SQ:
        return True
    if z.op() == ca.OP_ADD:
        return _is_sum_of_squares(z.dep(0)) and _is_sum_of_squares(z.dep(1))
    if z.op() == ca.OP_TWICE:
        return _is_sum_of_squares(z.dep(0))
    if z.op() == ca.OP_MUL:
        factor, rest = (z.dep(0), z.dep(1)) if z.dep(0).is_constant() else (z.dep(1), z.dep(0))
        return factor.is_constant() and float(factor) > 0 and _is_sum_of_squares(rest)
    return False
