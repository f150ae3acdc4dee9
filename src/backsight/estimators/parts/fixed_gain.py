"""Correction with a gain that was computed beforehand."""

import casadi as ca

from backsight.algebra.update import measured, noise_of
from backsight.estimators.parts.covariance import Term, joseph_form
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import Linear
from backsight.estimators.parts.substeps import within_bounds
from backsight.types import Array


def correct_with(system: Linear, gain: Array) -> ca.Function:
    """Measurement update ``(x, P, u, y, mask) -> (x, P, flags)`` with a gain (nx, ny).

    Rows that were not measured are left out. P is the covariance of the estimate that this gain
    makes, by Joseph's formula; it holds for every gain. States outside their bounds are set to
    them.
    """
    s, C = system.s, ca.sparsify(ca.DM(system.C))

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
