r"""Pairs of sigma points where the states have bounds.

A pair :math:`\hat x \pm d` that leaves the bounds is not asked for. In its place the model is asked
at :math:`c \pm \tau d`: around the mean c that every state has between its bounds, the mean of the
truncated normal distribution, and with the largest :math:`\tau \le 1` that stays inside. There it
tells its slope along d, and no longer how it bends: with the images a and b of the pair and
:math:`f_0` of the mean, the two points have the images :math:`f_0 \pm (a - b) / (2 \tau)`.

So the model is never asked outside the bounds, and of a linear one the points tell everything: mean
and covariance are those of the Kalman filter. Points that are clipped, set to the bounds one by one
(Kandepu, Foss, Imsland, 2008, doi:10.1016/j.jprocont.2007.11.004), pull the mean away from a bound
and make the spread smaller in every prediction, whatever is measured.
"""

import dataclasses
from collections.abc import Callable
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from backsight.algebra.sigma import Weights, weights
from backsight.engine.loops import iterate
from backsight.errors import TuningError
from backsight.estimators.parts.covariance import Term, transposed
from backsight.estimators.parts.factors import each_column, on_top, sigma_columns
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.scaled import Setting

Outside: TypeAlias = Literal["moved", "clipped"]
"""What is done with sigma points outside the bounds of the states."""

NARROW = 1e-3
"""Bounds that are closer than that, in standard deviations, leave a uniform distribution."""


@dataclasses.dataclass(frozen=True)
class SigmaPoints:
    """How the points of a mean and a factor are chosen.

    Parameters
    ----------
    weights : Weights
    outside : {"moved", "clipped"}
        See `UKF`.
    """

    weights: Weights
    outside: Outside

    def placed(self, s: Setting) -> ca.Function:
        """Build ``(x, L) -> (X, pairs, held)`` of a mean inside the bounds and a lower factor.

        X (n, 2 n + 1) is where the model is asked: the mean, points in the direction of each
        column of L, opposite points. ``pairs`` (2, n) has the share of the distance of every pair
        that was left, and 1 if it was moved; ``held`` is 1 if a point is outside the bounds.
        """
        sizes, w = _sizes(s), self.weights
        if self.outside == "clipped" and _bounded(s):
            return half("clipped_points", s, lambda x, L: _clipped(s, w, x, L), sizes)
        plain = half("sigma_points", s, lambda x, L: _plain(s, w, x, L), sizes)
        if not _bounded(s):
            return plain
        moved = half("moved_points", s, lambda x, L: _moved(s, w, x, L), sizes)
        x, L = (ca.MX.sym(plain.name_in(k), *plain.size_in(k)) for k in range(2))
        X, pairs, held = plain(x, L)
        # Where no pair leaves the bounds, as nearly always, nothing more is computed.
        asked = _where(held, lambda _, known: moved.call(known), [X, pairs], [x, L])
        return ca.Function("placed", [x, L], [*asked, held])

    def told(self, s: Setting, m: int) -> ca.Function:
        """Build ``(X, pairs, held) -> X``: images (m, 2 n + 1) of the points, from those of X."""
        n = s.model.nx
        given = [ca.MX.sym("X", m, 2 * n + 1), ca.MX.sym("pairs", 2, n), ca.MX.sym("held")]
        images, pairs, held = given
        if self.outside == "clipped" or not _bounded(s):
            return ca.Function("told", given, [images])
        sizes = {**_sizes(s), "X": (m, 2 * n + 1)}
        further = half("extrapolated", s, lambda X, pairs: _told(m, X, pairs), sizes)
        seen = _where(held, lambda X, known: further.call([*X, *known]), [images], [pairs])
        return ca.Function("told", given, seen)


def _where(
    flag: ca.MX,
    change: Callable[[list[ca.MX], list[ca.MX]], list[ca.MX]],
    values: list[ca.MX],
    others: list[ca.MX],
) -> list[ca.MX]:
    """``change(values, others)`` where the flag is not zero, else the values."""
    go, kept = ca.MX.sym("go"), [ca.MX.sym(f"v{k}", *v.shape) for k, v in enumerate(values)]
    held = [ca.MX.sym(f"c{k}", *v.shape) for k, v in enumerate(others)]
    body = ca.Function("outside", [go, *kept, *held], [ca.MX(0), *change(kept, held)])
    return iterate(body, 1, carry=[flag, *values], constants=others)[1:]


def _sizes(s: Setting) -> dict[str, int | tuple[int, int]]:
    n = s.model.nx
    return {"x": n, "L": (n, n), "X": (n, 2 * n + 1), "pairs": (2, n), "held": 1}


def points_of(
    s: Setting, *, alpha: float, beta: float, kappa: float, outside: Outside = "moved"
) -> SigmaPoints:
    """How the sigma points of a model are chosen; raises `TuningError`, see `UKF`."""
    n = s.model.nx
    if not n + kappa > 0:
        raise TuningError(f"kappa is {kappa}; it must be above -{n} for {n} states")
    return SigmaPoints(weights(n, alpha=alpha, beta=beta, kappa=kappa), outside)


def _bounded(s: Setting) -> bool:
    return bool(np.isfinite(s.lower).any() or np.isfinite(s.upper).any())


def _plain(s: Setting, w: Weights, x: Term, L: Term) -> Results:
    """All points where they are, and whether one of them is outside the bounds."""
    held = type(x)(0)
    if _bounded(s):
        n = s.model.nx
        leaves = leaf("leaves_bounds", {"d": n, "x": n}, lambda d, x: _leaves(s, w.spread * d, x))
        held = ca.mmax(each_column(leaves, L, x)[0])
    return {"X": sigma_columns(x, L, w.spread), "pairs": _as_they_are(s, x), "held": held}


def _as_they_are(s: Setting, like: Term) -> Term:
    return type(like)(ca.DM(np.outer([1.0, 0.0], np.ones(s.model.nx))))


def _moved(s: Setting, w: Weights, x: Term, L: Term) -> Results:
    """Pairs that leave the bounds are moved inside."""
    n = s.model.nx
    sizes = {**notation(s), "d": n, "c": n, "sigma": n}
    norm = leaf("row_size", sizes, lambda d: {"size": ca.norm_2(d)})
    between = leaf("truncated", sizes, lambda x, sigma: _between(s, x, sigma))
    place = leaf("place_pair", sizes, lambda d, x, c: _placed(s, d, x, c))
    c = between(x, transposed(each_column(norm, transposed(L))[0]))
    high, low, pairs = each_column(place, w.spread * L, x, c)
    return {"X": ca.horzcat(x, high, low), "pairs": pairs}


def _clipped(s: Setting, w: Weights, x: Term, L: Term) -> Results:
    """Each point is set to the bounds that it is beyond."""
    plain = sigma_columns(x, L, w.spread)
    within = leaf("within", notation(s), lambda x: {"x_in": within_bounds(s, x)})
    (inside,) = each_column(within, plain)
    held = ca.if_else(ca.norm_1(ca.vec(inside - plain)) > 0, 1, 0)
    return {"X": inside, "pairs": _as_they_are(s, x), "held": held}


def _told(m: int, images: Term, pairs: Term) -> Results:
    """Images of pairs, from those of points that may have been moved."""
    n = pairs.shape[1]
    column = leaf("extrapolate_pair", {"pair": 2 * m + 2, "centre": m}, _extrapolated)
    both = on_top([images[:, 1 : n + 1], images[:, n + 1 :], pairs])
    high, low = each_column(column, both, images[:, 0])
    return {"X_told": ca.horzcat(images[:, 0], high, low)}


def _between(s: Setting, x: ca.SX, sigma: ca.SX) -> Results:
    """Mean of every state if its normal distribution is cut off at its bounds."""
    c = ca.SX(x)
    for i, (low, high) in enumerate(zip(s.lower, s.upper, strict=True)):
        if not (np.isfinite(low) or np.isfinite(high)):
            continue
        size = ca.if_else(sigma[i] > 0, sigma[i], 1)
        density, share = [0.0, 0.0], [0.0, 1.0]
        for end, bound in enumerate((low, high)):
            if np.isfinite(bound):
                z = (bound - x[i]) / size
                density[end] = ca.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
                share[end] = (1 + ca.erf(z / np.sqrt(2))) / 2
        wide = high - low > NARROW * size
        cut = x[i] + size * (density[0] - density[1]) / ca.if_else(wide, share[1] - share[0], 1)
        middle = (low + high) / 2 if np.isfinite(high - low) else 0.0
        c[i] = ca.if_else(sigma[i] > 0, ca.if_else(wide, cut, middle), x[i])
    return {"centre": within_bounds(s, c)}


def _leaves(s: Setting, d: ca.SX, x: ca.SX) -> Results:
    """Whether the pair x +- d leaves the bounds."""
    outside = ca.SX(0)
    for i, (low, high) in enumerate(zip(s.lower, s.upper, strict=True)):
        if np.isfinite(low) or np.isfinite(high):
            outside = ca.if_else(ca.fabs(d[i]) > _room(x[i], low, high), 1, outside)
    return {"outside": outside}


def _placed(s: Setting, d: ca.SX, x: ca.SX, c: ca.SX) -> Results:
    """The pair x +- d, or c +- share d if it leaves the bounds."""
    outside, share = _leaves(s, d, x)["outside"], ca.SX(1)
    for i, (low, high) in enumerate(zip(s.lower, s.upper, strict=True)):
        if np.isfinite(low) or np.isfinite(high):
            size, room = ca.fabs(d[i]), _room(c[i], low, high)
            share = ca.fmin(share, ca.if_else(size > room, room / size, 1))
    share = ca.if_else(outside, share, 1)
    centre = ca.if_else(outside, c, x)
    # Sums are rounded; the bounds are not.
    ends = (within_bounds(s, centre + share * d), within_bounds(s, centre - share * d))
    return {"high": ends[0], "low": ends[1], "pairs": ca.vertcat(share, outside)}


def _room(x: ca.SX, low: float, high: float) -> ca.SX:
    """Distance to the nearer bound."""
    above = x - low if np.isfinite(low) else ca.SX(np.inf)
    return ca.fmin(above, high - x) if np.isfinite(high) else above


def _extrapolated(pair: ca.SX, centre: ca.SX) -> Results:
    m = centre.numel()
    a, b, share, moved = ca.vertsplit(pair, [0, m, 2 * m, 2 * m + 1, 2 * m + 2])
    slope = (a - b) / (2 * share)
    return {
        "high": ca.if_else(moved, centre + slope, a),
        "low": ca.if_else(moved, centre - slope, b),
    }
