"""The whole window of a sample: states, noise, residuals, multipliers and covariances."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine import vm
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.estimators.mhe._sample import Parts, memory, solved
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.memory import Memory
from backsight.solvers.trajectory import smoothed_all
from backsight.types import Array


def inspection(parts: Parts) -> ca.Function:
    """``(carry, u, y, mask) -> (present, x, P, w, v, multiplier, side, course)``.

    One column per sample of the window, physical units; P as lower triangles. ``w`` is the process
    noise that led to the sample; multipliers are derivatives of half the cost by the limit.
    ``course`` is the number of iterations and the status of the optimiser.
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
    names = ["present", "x", "P", "w", "v", "multiplier", "side", "course"]
    return ca.Function(
        "inspect",
        w.inputs,
        [w.present, x, P, noise, v, multiplier, found["side"], _course(found)],
        ["carry", "u", "y", "mask"],
        names,
    )


def filled(parts: Parts, guess: Recursion, u: Array, y: Array, mask: Array) -> Array:
    """See `Inspection`; the optimiser starts where the filter `guess`, of the same noise, is."""
    s, m = parts.s, memory(parts)
    _, found = vm.run(guess, [u, y, mask], carry=guess.carry0)
    by_name = {c.name: c.unpack(v) for c, v in zip(guess.channels, found, strict=True)}
    X, P = by_name["x_hat"] / s.sx, by_name["P"] / np.outer(s.sx, s.sx)
    lost = ~(np.isfinite(X).all(axis=1) & np.isfinite(P).all(axis=(1, 2)))
    X[lost], P[lost] = s.x0, s.P0
    columns = {"U": u / s.su, "Y": y / s.sy, "M": mask, "X": X, "present": np.ones((len(u), 1))}
    parts_of = {name: np.array(value) for name, value in m.parts(m.start).items()}
    for name, rows in columns.items():
        parts_of[name][:, parts.chain.N + 1 - len(rows) :] = rows.T
    # Before the window begins nothing moves: all is as at its first sample.
    parts_of["X"][:, : parts.chain.N + 1 - len(X)] = X[0][:, None]
    parts_of["x_last"], parts_of["P_last"] = X[-1], parts.chain.stored(P[-1])
    return Memory(**parts_of).start


def _course(found: dict[str, ca.MX]) -> ca.MX:
    """Number of iterations, and what the optimiser has to report."""
    names = ("iterations", "limit", "open", "rejected")
    symbols = [ca.SX.sym(name) for name in names]
    count, limit, unfinished, rejected = symbols
    flags = Flags(iteration_limit=ca.fmax(limit, unfinished), step_rejected=rejected)
    course = ca.Function("course", symbols, [ca.vertcat(count, flags.status())])
    return course(*(found[name] for name in names))


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
            "w": ca.densify(ca.SX(s.sx) * chain.noise_along(before, eta)),
            "v": ca.densify(ca.SX(s.sy) * (y - s.model.output(x, u))),
            "multiplier": ca.densify(nu / ca.SX(parts.limits.unit)),
        }

    window = {"k": 1, "P": chain.size_P, "eta": s.model.nx, "nu": chain.n}
    window["before"] = chain.sizes["before"]
    return leaf("physical_sample", {**notation(s), **window}, formula)
