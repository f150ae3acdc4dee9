"""A recursion that weighs every channel of a sample by how surprising it is."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.outliers import DOUBTED, SHARE, AbstractOutlierRule
from backsight.schema import WEIGHT, Status


def robust(plain: Recursion, rule: AbstractOutlierRule) -> Recursion:
    """Wrap a recursion that takes weights as its mask, see `backsight.estimators.outliers`.

    The memory has the plain one's in front. ``e`` and ``S`` that are put out are those that the
    rule saw, with the nominal noise. What is put out of an earlier sample (`lag`) has the weights
    and the innovation of that sample.

    Parameters
    ----------
    plain : Recursion
    rule : AbstractOutlierRule
    """
    ny, lag = plain.input_sizes[1], plain.lag
    carry, *data = _symbols(plain, behind=_size(ny) * lag)
    u, y, mask = data
    ends = [0, len(plain.carry0), len(plain.carry0) + ny, carry.numel()]
    inside, _, waiting = ca.vertsplit(carry, ends)

    # The weights, then the step itself with them; what both compute is computed once.
    *newest, share = entering(plain, rule).call([carry, *data], True, False)
    w = newest[0]
    after, *values = plain.step.call([inside, u, y, mask * w], True, False)
    queue = ca.horzcat(ca.reshape(waiting, _size(ny), lag), ca.vertcat(*newest))
    w, opened, e, S = ca.vertsplit(queue[:, 0], [0, ny, ny + 1, 2 * ny + 1, _size(ny)])
    outputs = dict(zip([c.name for c in plain.channels], values, strict=True))
    outputs |= {"e": e, "S": S, WEIGHT: w}
    outputs["status"] += int(Status.GATE_OPEN) * opened
    moved = ca.vertcat(after, share, ca.vec(queue[:, 1:]))
    empty = np.concatenate([np.ones(ny), np.zeros(_size(ny) - ny)])
    return Recursion(
        step=ca.Function(plain.name, [carry, *data], ca.cse([moved, *outputs.values()])),
        carry0=np.concatenate([plain.carry0, np.zeros(ny), np.tile(empty, lag)]),
        channels=(*plain.channels, Channel(WEIGHT, ("output",))),
        dt=plain.dt,
        least_samples=plain.least_samples,
        lag=lag,
    )


def entering(plain: Recursion, rule: AbstractOutlierRule) -> ca.Function:
    """What a rule makes of a sample: ``(carry, u, y, mask) -> (w, opened, e, S, share)``.

    The carry is that of `robust`. The innovation is that of the step with the plain mask, of which
    CasADi computes only what this needs. Where nothing was measured, w is 1.
    """
    ny = plain.input_sizes[1]
    carry, *data = _symbols(plain, behind=_size(ny) * plain.lag)
    ends = [0, len(plain.carry0), len(plain.carry0) + ny, carry.numel()]
    inside, share, _ = ca.vertsplit(carry, ends)
    before = plain.innovation or innovation_alone(plain)
    e, S = before.call([inside, *data], True, False)
    w, opened, share = _judged(rule, ny, data[0].numel())(e, S, data[2], share, data[0])
    return ca.Function("entering", [carry, *data], [w, opened, e, S, share])


def _size(ny: int) -> int:
    """How many numbers wait of a sample: weights, whether the rule opened, e, S."""
    return 2 * ny + 1 + ny * (ny + 1) // 2


def _symbols(plain: Recursion, *, behind: int) -> list[ca.MX]:
    """Symbols of the carry, with shares of outliers and what waits behind it, and of the data."""
    nu, ny, _ = plain.input_sizes
    sizes = {"carry": len(plain.carry0) + ny + behind, "u": nu, "y": ny, "m": ny}
    return [ca.MX.sym(name, size) for name, size in sizes.items()]


def innovation_alone(plain: Recursion) -> ca.Function:
    """``(carry, *data) -> (e, S)`` of a recursion that does not look back."""
    sizes = (len(plain.carry0), *plain.input_sizes)
    data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes)]
    values = plain.step.call(data, True, False)[1:]
    named = dict(zip([c.name for c in plain.channels], values, strict=True))
    return ca.Function("innovation_alone", data, [named["e"], named["S"]])


def _judged(rule: AbstractOutlierRule, ny: int, nu: int) -> ca.Function:
    """``(e, S, mask, share, u) -> (w, opened, share)``."""
    e, vS = ca.SX.sym("e", ny), ca.SX.sym("S", ny * (ny + 1) // 2)
    mask, share, u = ca.SX.sym("mask", ny), ca.SX.sym("share", ny), ca.SX.sym("u", nu)
    ratio, seen = e**2 / ca.diag(unvech(vS)), mask > 0
    # What is not a number is no reason to leave a sample out; the status tells of it.
    w = rule.weight(ca.if_else(ratio >= 0, ratio, 0), u)
    outlier = ca.logic_and(seen, w < DOUBTED)
    kept = ca.if_else(seen, share + (outlier - share) / rule.patience, share)
    opens = ca.logic_and(seen, kept > SHARE)
    weight = ca.if_else(ca.logic_and(seen, ca.logic_not(opens)), w, 1)
    opened = ca.mmax(ca.logic_and(opens, outlier))
    results = [ca.densify(r) for r in (weight, opened, kept)]
    return ca.Function("judged", [e, vS, mask, share, u], results)
