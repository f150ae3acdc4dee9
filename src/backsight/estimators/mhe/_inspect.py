"""The whole window of a sample: states, noise, residuals, multipliers and covariances."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.loops import scan
from backsight.estimators.mhe._sample import Parts, solved
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
    m = s.model
    sizes = {
        "k": 1, "x": m.nx, "P": chain.size_P, "eta": m.nx, "nu": chain.n,
        "u": m.nu, "y": m.ny, "before": 1,
    }  # fmt: skip
    k, x, vP, eta, nu, u, y, before = symbols = [ca.SX.sym(n, i) for n, i in sizes.items()]
    results = [
        ca.SX(s.sx) * x,
        vech(chain.matrix(vP) * ca.SX(np.outer(s.sx, s.sx))),
        ca.SX(s.sx) * (before * (ca.SX(ca.DM(chain.Q)) @ eta)),
        ca.SX(s.sy) * (y - m.output(x, u)),
        nu / ca.SX(parts.limits.unit),
    ]
    return ca.Function("physical_sample", symbols, [k + 1, *map(ca.densify, results)])
