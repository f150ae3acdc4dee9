"""The whole window of a sample: states, noise, residuals, multipliers and covariances."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.loops import scan
from backsight.estimators.mhe._sample import Parts, solved
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.solvers.trajectory import smoothed_all


def inspection(parts: Parts) -> ca.Function:
    """``(carry, u, y, mask) -> (present, x, P, w, v, multiplier, side)``.

    One column per sample of the window, physical units; P as lower triangles. ``w`` is the process
    noise that led to the sample; multipliers are derivatives of half the cost by the limit.
    """
    chain = parts.chain
    w = solved(parts)
    covariances = smoothed_all(chain)(*w.problem)
    found = w.found
    _, columns = scan(
        _physical(parts),
        chain.N + 1,
        carry=[ca.MX(0)],
        xs=[found["X"], covariances, found["eta"], found["nu"], w.U, w.Y, found["before"]],
    )
    x, P, noise, v, multiplier = columns
    names = ["present", "x", "P", "w", "v", "multiplier", "side"]
    return ca.Function(
        "inspect",
        w.inputs,
        [w.present, x, P, noise, v, multiplier, found["side"]],
        ["carry", "u", "y", "mask"],
        names,
    )


def _physical(parts: Parts) -> ca.Function:
    """One sample of the window in physical units."""
    s, chain = parts.s, parts.chain
    units = np.outer(s.sx, s.sx)

    def formula(
        k: ca.SX, x: ca.SX, P: ca.SX, eta: ca.SX, nu: ca.SX, u: ca.SX, y: ca.SX, before: ca.SX
    ) -> Results:
        return {
            "k": k + 1,
            "x": ca.SX(s.sx) * x,
            "triangle": ca.densify(vech(chain.matrix(P) * ca.SX(units))),
            "w": ca.densify(ca.SX(s.sx) * (before * (ca.SX(ca.DM(chain.Q)) @ eta))),
            "v": ca.densify(ca.SX(s.sy) * (y - s.model.output(x, u))),
            "multiplier": ca.densify(nu / ca.SX(parts.limits.unit)),
        }

    window = {"k": 1, "P": chain.size_P, "eta": s.model.nx, "nu": chain.n, "before": 1}
    return leaf("physical_sample", {**notation(s), **window}, formula)
