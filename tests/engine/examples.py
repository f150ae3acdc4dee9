"""Small recursions that go through every part of the engine."""

import casadi as ca
import numpy as np

from backsight.engine.loops import iterate, scan
from backsight.engine.recursion import Recursion


def recursion(step: ca.Function, seed: int = 0) -> Recursion:
    """A recursion that starts from random numbers."""
    rng = np.random.default_rng(seed)
    return Recursion(step, rng.standard_normal(step.numel_in(0)), channels=(), dt=1.0)


def data_for(r: Recursion, n: int, seed: int = 1) -> list[np.ndarray]:
    """Random data of n samples."""
    rng = np.random.default_rng(seed)
    return [rng.standard_normal((n, size)) for size in r.input_sizes]


def location() -> Recursion:
    """Loops in loops: the most likely centre of the last five samples, by Newton's method.

    The memory holds the centre and the window. Every sample the centre moves to the minimum of
    the sum of sqrt(1 + (w - centre)^2); how many steps that takes depends on the data.
    Outputs: centre, number of steps, the five terms, curvature and absolute gradient at the end.
    """
    a, w, g, h = (ca.SX.sym(name) for name in "awgh")
    root = ca.sqrt(1 + (w - a) ** 2)
    term = ca.Function("term", [g, h, w, a], [g - (w - a) / root, h + 1 / root**3, root])
    k, move = ca.SX.sym("k"), ca.fmin(ca.fmax(g / h, -1), 1)
    leaf = ca.Function("move", [a, k, g, h], [ca.fabs(move) > 1e-7, a - move, k + 1])

    go, centre, count, window = (ca.MX.sym("s", *s) for s in ((1, 1), (1, 1), (1, 1), (1, 5)))
    zeros = [ca.MX(0), ca.MX(0)]
    sums, _ = scan(term, 5, carry=zeros, xs=[window], constants=[centre])
    body = ca.Function("newton", [go, centre, count, window], leaf(centre, count, *sums))

    carry, y = ca.MX.sym("carry", 6), ca.MX.sym("y")
    moved = ca.horzcat(carry[2:].T, y)
    _, found, steps = iterate(body, 60, carry=[ca.MX(1), carry[0], ca.MX(0)], constants=[moved])
    (gradient, curvature), (terms,) = scan(term, 5, carry=zeros, xs=[moved], constants=[found])
    outputs = [
        ca.vertcat(found, moved.T),
        found,
        steps,
        ca.vec(terms),
        curvature,
        ca.fabs(gradient) < 1e-6,
    ]
    return recursion(ca.Function("location", [carry, y], outputs))
