"""The pass forward and the pass back of a filter that consists of two halves."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.dense import UNROLL, product_of, triangle
from backsight.engine.recursion import Channel, ForwardBackward
from backsight.estimators.base import ESTIMATE_CHANNELS, Setting, Spread
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    matrix_product,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.factors import on_top
from backsight.estimators.parts.filtering import Halves, data_inputs, sample
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import (
    Results,
    Symmetric,
    half,
    leaf,
    named_results,
    notation,
)
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.smoothing.information import carried_back, combined_with, noise_passed
from backsight.estimators.smoothing.two_filter import combined, gathered, weakened
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Linearised:
    """The model as a filter saw it at a sample; matrices dense.

    Parameters
    ----------
    root : casadi.Function
        ``spread -> L``, the lower factor of the covariance.
    ahead : casadi.Function, or (F, G)
        ``(x, spread, u, u_next) -> (F, G)`` of a posterior: how deviations go to the next sample,
        and a factor of the covariance of what is added there; or both, if they are constant.
    seen : casadi.Function
        ``(x_prior, spread_prior, x_post, u, y, mask) -> (H', e)``: deviations from the prior as the
        outputs show them, in units of the noise, and the residual at the prior.
    by_root : bool
        Whether the way back needs the root of the information, see `information.drowned`.
    """

    root: ca.Function
    ahead: ca.Function | tuple[Array, Array]
    seen: ca.Function
    by_root: bool

    @property
    def sees_spread(self) -> bool:
        """Whether `seen` depends on the spread of the prior."""
        rows = range(self.seen.n_out())
        return any(self.seen.jac_sparsity(k, 1).nnz() for k in rows)

    @property
    def constant(self) -> tuple[Array, Array] | None:
        """F and G, if they are the same at every sample."""
        return self.ahead if isinstance(self.ahead, tuple) else None

    @property
    def noises(self) -> int:
        """Columns of G."""
        return self.ahead[1].shape[1] if isinstance(self.ahead, tuple) else self.ahead.size2_out(1)


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

    nx = s.model.nx
    kept, back = ("U", "zeta"), _back_by_root(s, linearised)
    start = {"U": np.zeros((nx, nx)), "zeta": np.zeros(nx)}
    if not linearised.by_root:
        kept, back = ("J", "eta"), _back(s, linearised)
        start = {"J": np.zeros(Covariance(nx).size), "eta": np.zeros(nx)}
    m = Memory(**start)
    estimates = {k: ca.MX.sym(k, v.numel()) for k, v in handed.items()}
    x_prior, x_post, spread_post = (estimates[k] for k in ("x_prior", "x_post", "spread_post"))
    spread_prior = estimates.get("spread_prior", spread_post)
    data = data_inputs(s)
    u_next_given = ca.MX.sym("u_next", s.model.nu)
    u, y, mask = s.enter()(*data)
    u_next, _, _ = s.enter()(u_next_given, *data[1:])
    Ht, e = linearised.seen(x_prior, spread_prior, x_post, u, y, mask)
    matrices: list[ca.MX] = []
    if isinstance(linearised.ahead, ca.Function):
        matrices = list(linearised.ahead(x_post, spread_post, u, u_next))
    known = [getattr(m, k) for k in kept]
    root = linearised.root(spread_post)
    found = named_results(back, *known, x_prior, x_post, root, Ht, e, *matrices)
    outputs = leaving(s, covariance=covariance)(found["x"], found["Tt"], u)
    channels = smoothed_channels(covariance)
    backward = m.recursion(
        f"{name}_backward",
        [*estimates.values(), data[0], u_next_given, *data[1:]],
        next={k: found[k] for k in kept},
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


def _back(s: Setting, seen: Linearised) -> ca.Function:
    """One sample back, see `information`: what is told ahead, and the smoothed estimate.

    ``(J, eta, x_prior, x_post, L, H', e, *matrices) -> (J, eta, x, T')``; the matrices are F and G
    unless they are the same at every sample.
    """
    nx, ny, q = s.model.nx, s.model.ny, seen.noises
    sizes = {
        "J": Symmetric(nx), "eta": nx, "F": (nx, nx), "G": (nx, q), "Ht": (nx, ny), "L": (nx, nx),
        "Tt": (nx, nx),
    }  # fmt: skip

    def moved(
        J: Term, eta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        F: Term | ca.DM, G: Term | ca.DM,
    ) -> Results:  # fmt: skip
        # 1. What the samples ahead tell of the state after this one's measurement.
        J, eta = carried_back(*noise_passed(J, eta, G), F)
        # 2. The smoothed estimate.
        x, Tt = combined_with(x_post, L, J, eta)
        # 3. Together with this sample's measurement, as deviations from its prior.
        told = eta + matrix_product(J, x_post - x_prior) + matrix_product(Ht, e)
        return {"J": congruence(Ht, type(J)(ca.DM(np.eye(ny))), J), "eta": told, "x": x, "Tt": Tt}

    if seen.constant is None:
        return half("smoothed_sample", s, moved, sizes)
    F, G = (ca.sparsify(ca.DM(k)) for k in seen.constant)

    def fixed(
        J: Term, eta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term
    ) -> Results:
        return moved(J, eta, x_prior, x_post, L, Ht, e, F, G)

    return half("smoothed_sample", s, fixed, sizes)


def _back_by_root(s: Setting, seen: Linearised) -> ca.Function:
    """One sample back with the root of the information, see `two_filter`, else as `_back`."""
    nx, ny, q = s.model.nx, s.model.ny, seen.noises
    sizes = {
        "U": (nx, nx), "zeta": nx, "F": (nx, nx), "G": (nx, q), "Ht": (nx, ny), "L": (nx, nx),
        "Tt": (nx, nx),
    }  # fmt: skip

    def moved(
        U: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        F: Term, G: Term,
    ) -> Results:  # fmt: skip
        Vt, told = weakened(U, zeta, G)
        Vt = matrix_product(Vt, F)
        x, Tt = combined(x_post, L, Vt, told)
        right = told + matrix_product(Vt, x_post - x_prior)
        below = ca.horzcat(transposed(right), transposed(e))
        all_told = gathered(on_top([ca.horzcat(transposed(Vt), Ht), below]))
        return {
            "U": ca.densify(all_told[:nx, :nx]),
            "zeta": ca.densify(transposed(all_told[nx, :nx])),
            "x": x,
            "Tt": ca.densify(Tt),
        }

    if seen.constant is None:
        return half("smoothed_sample", s, moved, sizes)
    F, G = map(ca.DM, seen.constant)

    def fixed(
        U: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term
    ) -> Results:
        kind = type(U)
        return moved(U, zeta, x_prior, x_post, L, Ht, e, kind(F), kind(G))

    return half("smoothed_sample", s, fixed, sizes)
