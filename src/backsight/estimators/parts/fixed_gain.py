"""Correction with a gain that was computed beforehand."""

import casadi as ca

from backsight.algebra.update import measured, noise_of
from backsight.engine import dense
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    joseph_form,
    matrix_product,
    noise_of_many,
)
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import Linear
from backsight.estimators.parts.substeps import seen_outputs, settled, within_bounds
from backsight.types import Array


def correct_with(system: Linear, gain: Array) -> ca.Function:
    """Measurement update ``(x, P, u, y, mask) -> (x, P, flags)`` with a gain (nx, ny).

    Rows that were not measured are left out. P is the covariance of the estimate that this gain
    makes, by Joseph's formula; it holds for every gain. States outside their bounds are set to
    them.
    """
    s, C = system.s, ca.sparsify(ca.DM(system.C))
    if Covariance(s.model.nx).whole:
        return _correct_many(system, gain)

    def moved(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        seen = measured(mask)
        free = x + ca.mtimes(ca.DM(gain), seen * (y - s.model.output(x, u)))
        inside = within_bounds(s, free)
        flags = Flags(clipped=ca.if_else(ca.norm_1(inside - free) > 0, 1, 0))
        return {
            "x_post": inside,
            "K": ca.densify(ca.SX(ca.DM(gain)) @ ca.diag(seen)),
            "noise": noise_of(ca.SX(s.R), mask),
            "flags": flags.vector(),
        }

    observe = leaf("observe", notation(s), moved)

    def formula(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
        x_post, K, R, flags = observe(x, u, y, mask)
        return {"x_post": x_post, "P_post": joseph_form(P, K, C, R), "flags": flags}

    return half("correct", s, formula)


def _correct_many(system: Linear, gain: Array) -> ca.Function:
    """`correct_with` of many states."""
    s, C = system.s, ca.MX(dense.few_entries(system.C))

    def formula(x: ca.MX, P: ca.MX, u: ca.MX, y: ca.MX, mask: ca.MX) -> Results:
        e, K = looked_of_many(system, gain, (x, u, y, mask))
        free = x + matrix_product(ca.DM(gain), e)
        # Bounds only: the covariance of a gain that is given decides nothing.
        x_post, flags = settled(s)(free, ca.MX.ones(s.model.nx), ca.MX.ones(s.model.ny))
        noise = noise_of_many(ca.MX(ca.DM(s.R)), mask)
        return {"x_post": x_post, "P_post": joseph_form(P, K, C, noise), "flags": flags}

    return half("correct", s, formula)


def looked_of_many(
    system: Linear, gain: Array, at: tuple[ca.MX, ca.MX, ca.MX, ca.MX]
) -> tuple[ca.MX, ca.MX]:
    """Innovation, 0 where not measured, and the gain without these columns, of many states.

    `at` is x, u, y and mask.
    """
    s = system.s
    x, u, y, mask = at
    expected, _ = seen_outputs(s)(x, u)
    sizes = {**notation(s), "expected": s.model.ny, "seen": s.model.ny}
    e, seen = leaf(
        "missed",
        sizes,
        lambda y, expected, mask: {"e": measured(mask) * (y - expected), "seen": measured(mask)},
    )(y, expected, mask)
    return e, ca.MX(ca.DM(gain)) * dense.product_of(ca.MX.ones(len(gain), 1), seen.T)
