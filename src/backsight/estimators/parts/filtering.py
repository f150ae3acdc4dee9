"""Put a measurement update and a time update together to a recursion."""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS, Setting
from backsight.estimators.parts.gaussian import FLAGS
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Halves:
    """The parts of a filter. "Spread" is what it keeps of the covariance.

    Parameters
    ----------
    spread0 : array
        Spread of the prior.
    innovation : casadi.Function
        ``(x, spread, u, y, mask) -> (e, S)``.
    correct : casadi.Function
        ``(x, spread, u, y, mask) -> (x, spread, flags)``.
    predict : casadi.Function
        ``(x, spread, u, u_next) -> (x, spread)``.
    covariance : casadi.Function
        Spread to the lower triangle of the covariance.
    ramp : bool
        Whether the input is interpolated between samples.
    """

    spread0: Array
    innovation: ca.Function
    correct: ca.Function
    predict: ca.Function
    covariance: ca.Function
    ramp: bool


def assemble(name: str, s: Setting, halves: Halves) -> Recursion:
    """Recursion of a filter that consists of two halves.

    With held inputs the carry is the prior of the coming sample: correct, then predict. With
    ramped inputs the prediction needs the input of the coming sample: the carry is then the
    posterior of the last sample and its input, and prediction comes first (except at the start).
    """
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    memory = {"x": s.x0, "spread": halves.spread0}
    if halves.ramp:
        memory |= {"u_last": np.zeros(s.model.nu), "started": np.zeros(1)}
    symbol, (x, spread, *last) = carry_inputs(list(memory.values()))
    if halves.ramp:
        u_last, started = last
        x, spread = choose(started, halves.predict.call([x, spread, u_last, u]), [x, spread])
    e, S = halves.innovation(x, spread, u, y, mask)
    x, spread, flags = halves.correct(x, spread, u, y, mask)
    outputs = physical(s)(x, halves.covariance(spread), u, e, S, flags)
    carry = [x, spread, u, 1] if halves.ramp else halves.predict(x, spread, u, u)
    return Recursion(
        step=ca.Function(name, [symbol, *data], [ca.vertcat(*carry), *outputs]),
        carry0=np.concatenate(list(memory.values())),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )


def data_inputs(s: Setting) -> list[ca.MX]:
    """Symbols of one sample's data: u, y, mask."""
    return [ca.MX.sym(n, k) for n, k in (("u", s.model.nu), ("y", s.model.ny), ("m", s.model.ny))]


def carry_inputs(memory: Sequence[Array]) -> tuple[ca.MX, list[ca.MX]]:
    """Symbol of the whole carry and its parts, one for each (flat) array of the memory."""
    ends = np.cumsum([0, *(len(part) for part in memory)])
    symbol = ca.MX.sym("carry", int(ends[-1]))
    return symbol, ca.vertsplit(symbol, [int(e) for e in ends])


def packed(P: Array) -> Array:
    """Lower triangle of a symmetric matrix, (n (n + 1) / 2,)."""
    return P.T[np.triu_indices(len(P))]


def choose(flag: ca.MX, then: Sequence[ca.MX], otherwise: Sequence[ca.MX]) -> list[ca.MX]:
    """Elementwise `then` where the scalar flag is not zero, else `otherwise`."""
    sizes = [t.numel() for t in then]
    c = ca.SX.sym("c")
    a, b = ([ca.SX.sym("v", n) for n in sizes] for _ in range(2))
    selected = [ca.if_else(c, i, j) for i, j in zip(a, b, strict=True)]
    name = "choose_" + "_".join(map(str, sizes))
    return ca.Function(name, [c, *a, *b], selected).call([flag, *then, *otherwise])


def physical(s: Setting, raised: Sequence[Status] = FLAGS) -> ca.Function:
    """Scaled posterior to the outputs of `ESTIMATE_CHANNELS`.

    ``(x, P, u, e, S, flags) -> (x_hat, P, y_hat, e, S, status)``; every flag, 0 or 1, has its
    meaning in `raised`.
    """
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, u, e = ca.SX.sym("x", nx), ca.SX.sym("u", nu), ca.SX.sym("e", ny)
    vP, vS = ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("S", ny * (ny + 1) // 2)
    flags = ca.SX.sym("flags", len(raised))
    outputs = [
        *s.physical(x, vP),
        s.sy * s.model.output(x, u),
        s.sy * e,
        vech(unvech(vS) * ca.SX(np.outer(s.sy, s.sy))),
        ca.dot(flags, ca.DM([int(f) for f in raised])),
    ]
    return ca.Function("physical", [x, vP, u, e, vS, flags], outputs)
