"""The pass forward and the pass back of a filter that consists of two halves."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.dense import UNROLL, product_of, triangle
from backsight.engine.recursion import Channel, ForwardBackward
from backsight.estimators.base import ESTIMATE_CHANNELS, Setting, Spread
from backsight.estimators.parts.covariance import (
    Term,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.filtering import Halves, data_inputs, sample
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import (
    Results,
    half,
    leaf,
    named_results,
    notation,
)
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.smoothing._backward import Linearised, way_back


def passes(
    name: str, s: Setting, halves: Halves, linearised: Linearised, *, covariance: Spread
) -> ForwardBackward:
    """Pass forward and pass back of the two-filter smoother, see `two_filter`."""
    now = sample(s, halves)
    handed = {"x_prior": now.x_prior, "x_post": now.x, "spread_post": now.spread}
    if linearised.sees_spread:
        handed["spread_prior"] = now.spread_prior
    results = filter_channels(covariance)
    forward = now.memory.recursion(
        f"{name}_forward",
        now.data,
        next=now.next,
        outputs=handed | {c.name: now.outputs[c.name] for c in results},
        channels=(*(Channel(k, ("entry",)) for k in handed), *results),
        dt=s.dt,
    )

    start, back = way_back(s, linearised)
    m = Memory(**start)
    estimates = {k: ca.MX.sym(k, v.numel()) for k, v in handed.items()}
    x_prior, x_post, spread_post = (estimates[k] for k in ("x_prior", "x_post", "spread_post"))
    spread_prior = estimates.get("spread_prior", spread_post)
    data = data_inputs(s)
    u_next_given = ca.MX.sym("u_next", s.model.nu)
    u, y, mask = s.enter()(*data)
    u_next, _, _ = s.enter()(u_next_given, *data[1:])
    looked = linearised.seen.call([x_prior, spread_prior, x_post, u, y, mask])
    matrices: list[ca.MX] = []
    if isinstance(linearised.ahead, ca.Function):
        matrices = list(linearised.ahead(x_post, spread_post, u, u_next))
    known = [getattr(m, k) for k in start]
    root = linearised.root(spread_post)
    found = named_results(back, *known, x_prior, x_post, root, *looked, *matrices)
    outputs = leaving(s, covariance=covariance)(found["x"], found["Tt"], u)
    channels = smoothed_channels(covariance)
    backward = m.recursion(
        f"{name}_backward",
        [*estimates.values(), data[0], u_next_given, *data[1:]],
        next={k: found[k] for k in start},
        outputs={c.name: v for c, v in zip(channels, outputs, strict=True)},
        channels=channels,
        dt=s.dt,
    )
    return ForwardBackward(forward, backward)


def filter_channels(covariance: Spread) -> tuple[Channel, ...]:
    """What the pass forward puts out: innovations, their covariance, and the status."""
    kept = ("e", "S", "status") if covariance == "full" else ("e", "status")
    return tuple(c for c in ESTIMATE_CHANNELS if c.name in kept)


def smoothed_channels(covariance: Spread) -> tuple[Channel, ...]:
    """What the pass back puts out."""
    spread = {c.name: c for c in ESTIMATE_CHANNELS} | {"x_std": Channel("x_std", ("state",))}
    kept = ("x_hat", "P" if covariance == "full" else "x_std", "y_hat", "status")
    return tuple(spread[name] for name in kept)


def leaving(s: Setting, *, covariance: Spread, rows: int | None = None) -> ca.Function:
    """``(x, T', u) -> smoothed_channels`` of a scaled estimate and the root of its covariance.

    T' has so many `rows`, by default as many as there are states. States outside their bounds are
    set to them, as by the filter.
    """
    nx = s.model.nx
    sizes = {**notation(s), "Tt": (rows or nx, nx), "P": (nx * (nx + 1) // 2)}

    def inside(x: ca.SX, u: ca.SX) -> Results:
        x_in = within_bounds(s, x)
        clipped = ca.if_else(ca.norm_1(x_in - x) > 0, 1, 0)
        outputs = s.sy * s.model.output(x_in, u)
        return {"x_hat": s.sx * x_in, "outputs": outputs, "status": Flags(clipped=clipped).status()}

    def spread(Tt: Term) -> Results:
        product_of_roots = times_transposed(transposed(Tt), transposed(Tt))
        return {"all": product_of_roots}

    settled = leaf("smoothed_within", sizes, inside)
    if nx > UNROLL:
        root, whole = ca.MX.sym("Tt", rows or nx, nx), ca.MX.sym("P", nx, nx)
        packed = ca.Function("smoothed_covariance", [whole], [triangle(whole, s.sx)])
        squares = product_of(ca.MX.ones(1, rows or nx), root * root)
        lengths = ca.DM(s.sx) * ca.sqrt(squares.T)
        deviations = ca.Function("smoothed_deviations", [root], [lengths])
    else:
        P, root = ca.SX.sym("P", nx, nx), ca.SX.sym("Tt", rows or nx, nx)
        scaled = P * ca.SX(np.outer(s.sx, s.sx))
        packed = ca.Function("smoothed_covariance", [P], [vech(scaled)])
        lengths = ca.vertcat(*(s.sx[i] * ca.norm_2(root[:, i]) for i in range(nx)))
        deviations = ca.Function("smoothed_deviations", [root], [lengths])
    squared = half("squared_root", s, spread, sizes)
    x, T, u = ca.MX.sym("x", nx), ca.MX.sym("Tt", rows or nx, nx), ca.MX.sym("u", s.model.nu)
    x_hat, y_hat, status = settled(x, u)
    kept = packed(squared(T)) if covariance == "full" else deviations(T)
    return ca.Function("leaving", [x, T, u], [x_hat, kept, y_hat, status])
