"""Put a measurement update and a time update together to a recursion."""

import dataclasses
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.dense import UNROLL, triangle
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.parts.flags import FLAGS, Flags
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import seen_outputs
from backsight.estimators.scaled import Setting
from backsight.models.lti import state_equation
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Halves:
    """The parts of a filter. "Spread" is what it keeps of the covariance.

    Parameters
    ----------
    spread_of : callable
        Covariance (nx, nx) in numbers to its spread.
    innovation : casadi.Function
        ``(x, spread, u, y, mask) -> (e, S)``.
    correct : casadi.Function
        ``(x, spread, u, y, mask) -> (x, spread, flags)``; flags as `Flags.vector`.
    predict : casadi.Function
        ``(x, spread, u, u_next) -> (x, spread)``.
    covariance : casadi.Function
        Spread to the lower triangle of the covariance.
    ramp : bool
        Whether the input is interpolated between samples.
    iterated : bool
        Whether `correct` linearises at its own result.
    """

    spread_of: Callable[[Array], Array]
    innovation: ca.Function
    correct: ca.Function
    predict: ca.Function
    covariance: ca.Function
    ramp: bool
    iterated: bool = False


@dataclasses.dataclass(frozen=True)
class Sample:
    """One sample of a filter of two halves: its memory, what it takes, and what it finds.

    Parameters
    ----------
    memory : Memory
    data : list of MX
        Symbols of u, y and mask, physical.
    x_prior, spread_prior, x, spread : MX
        Before and after the measurement.
    next : dict
        Memory of the next sample.
    outputs : dict
        Values of `ESTIMATE_CHANNELS`.
    """

    memory: Memory
    data: list[ca.MX]
    x_prior: ca.MX
    spread_prior: ca.MX
    x: ca.MX
    spread: ca.MX
    next: dict[str, ca.MX | float]
    outputs: dict[str, ca.MX]


def assemble(name: str, s: Setting, halves: Halves) -> Recursion:
    """Recursion of a filter that consists of two halves, see `sample`."""
    now = sample(s, halves)
    plain = now.memory.recursion(
        name, now.data, next=now.next, outputs=now.outputs, channels=ESTIMATE_CHANNELS, dt=s.dt
    )
    behind = plain.carry0[s.model.nx + len(halves.spread_of(s.P0)) :]
    return dataclasses.replace(plain, start=PriorMemory(halves.spread_of, s.sx, behind))


@dataclasses.dataclass(frozen=True)
class PriorMemory:
    """The memory before the first sample for a prior, see `Recursion.start`.

    Parameters
    ----------
    spread_of : callable
        See `Halves`.
    sx : (nx,) array
        Scales of the states.
    behind : array
        What lies behind state and spread.
    """

    spread_of: Callable[[Array], Array]
    sx: Array
    behind: Array

    def __call__(self, x0: Array, P0: Array) -> Array:
        """Of a mean (nx,) and a covariance (nx, nx), physical."""
        spread = self.spread_of(P0 / np.outer(self.sx, self.sx))
        return np.concatenate([x0 / self.sx, spread, self.behind])


def sample(s: Setting, halves: Halves) -> Sample:
    """One sample of a filter that consists of two halves.

    With held inputs the carry is the prior of the coming sample: correct, then predict. With
    ramped inputs the prediction needs the input of the coming sample: the carry is then the
    posterior of the last sample and its input, and prediction comes first (except at the start).
    So it is with the noise of an input of which the last value is remembered: it is known better
    with this sample, and the sample is corrected once more, see `noise_to_look_back_at`.
    """
    data, noise = data_inputs(s), noise_to_look_back_at(s)
    late = halves.ramp or bool(noise)
    u, y, mask = s.enter()(*data)
    parts = {"x": s.x0, "spread": halves.spread_of(s.P0)}
    if late:
        parts |= {"u_last": np.zeros(s.model.nu), "started": np.zeros(1)}
    m = Memory(**parts)
    x_prior, spread_prior = m.x, m.spread
    if late:
        predicted = halves.predict.call([m.x, m.spread, m.u_last, u])
        x_prior, spread_prior = choose(m.started, predicted, [m.x, m.spread])
    e, S = halves.innovation(x_prior, spread_prior, u, y, mask)
    x, spread, flags = halves.correct(x_prior, spread_prior, u, y, mask)
    if noise:
        last, at, moved = looked_back(s, noise, iterated=halves.iterated)(m.x, x_prior, x, u)
        _, again = halves.predict(last, m.spread, m.u_last, u)
        (spread_prior,) = choose(m.started, [again], [m.spread])
        x, spread, flags = halves.correct(at, spread_prior, u, y + moved, mask)
        x = x + (x_prior - at)
    after: dict[str, ca.MX | float]
    if late:
        after = {"x": x, "spread": spread, "u_last": u, "started": 1}
    else:
        after = dict(zip(("x", "spread"), halves.predict(x, spread, u, u), strict=True))
    # Taken apart where it is made of operations on matrices, so that `triangle` sees through it.
    (P,) = halves.covariance.call([spread], halves.covariance.is_a("MXFunction"), False)
    return Sample(
        memory=m,
        data=data,
        x_prior=x_prior,
        spread_prior=spread_prior,
        x=x,
        spread=spread,
        next=after,
        outputs=physical(s, x=x, P=P, u=u, e=e, S=S, flags=flags),
    )


@dataclasses.dataclass(frozen=True)
class Remembered:
    r"""White noise among the states, and the state that was this noise a sample ago.

    Parameters
    ----------
    now, last : int
        Places of :math:`\omega_k` and :math:`c\,\omega_{k-1}` in the state.
    scale : float
        c.
    """

    now: int
    last: int
    scale: float


def noise_to_look_back_at(s: Setting) -> tuple[Remembered, ...]:
    r"""Noise whose last value is among the states: :math:`\omega_{k+1} = 0`, and a copy of it.

    A filter linearises the way to the next sample where it is, at :math:`\hat\omega = 0`: what
    multiplies an input is then learned from the input as it was measured. That is a regression on
    noisy values, whose slope is too small by :math:`\sigma_u^2 / u^2` however long it lasts. The
    next sample tells what the input was; with the derivative there the slope is right: one step of
    the iterated Kalman smoother over the last sample (Bell, "The iterated Kalman smoother as a
    Gauss-Newton method", 1994, doi:10.1137/0804035). The mean of the prediction is that of the
    first time, of an input that enters linearly it is the same. Outputs that show the input
    (feedthrough) are linearised at what the sample itself tells, with the innovation as it was.
    """
    if s.model.continuous or state_equation(s.model) is not None:
        return ()
    x = ca.SX.sym("x", s.model.nx)
    symbols = ca.vertsplit(x)
    step = ca.SX(s.model.rhs(x, ca.SX.sym("u", s.model.nu)))
    forgotten = [i for i in range(s.model.nx) if step[i].is_zero()]
    found = []
    for i in range(s.model.nx) if forgotten else ():
        kept = [j for j in forgotten if ca.which_depends(step[i], symbols[j])[0]]
        slope = ca.jacobian(step[i], x)
        if len(kept) == 1 and slope.nnz() == 1 and slope.is_constant():
            found.append(Remembered(kept[0], i, float(slope.nz[0])))
    return tuple(found)


def looked_back(s: Setting, noise: Sequence[Remembered], *, iterated: bool) -> ca.Function:
    """Where to linearise again: ``(x_last, x_prior, x, u) -> (x_last, x_prior, moved)``.

    The states with the noise as it is known after the sample, and by how much the expected output
    changes with that of the sample itself, which a correction that is `iterated` finds anyway.
    """
    x_last, x_prior, x = (ca.SX.sym(name, s.model.nx) for name in ("x_last", "x_prior", "x"))
    u, last, at = ca.SX.sym("u", s.model.nu), ca.SX(x_last), ca.SX(x_prior)
    for one in noise:
        last[one.now] = x[one.last] / one.scale
        at[one.now] = x_prior[one.now] if iterated else x[one.now]
    moved = ca.densify(s.model.output(at, u) - s.model.output(x_prior, u))
    return ca.Function("looked_back", [x_last, x_prior, x, u], [last, at, moved])


def data_inputs(s: Setting) -> list[ca.MX]:
    """Symbols of one sample's data: u, y, mask."""
    return [ca.MX.sym(n, k) for n, k in (("u", s.model.nu), ("y", s.model.ny), ("m", s.model.ny))]


LARGE = 256
"""Numbers from which on a choice is a loop."""


def choose(flag: ca.MX, then: Sequence[ca.MX], otherwise: Sequence[ca.MX]) -> list[ca.MX]:
    """Elementwise `then` where the scalar flag is not zero, else `otherwise`."""
    if max(t.numel() for t in then) > LARGE:
        pairs = zip(then, otherwise, strict=True)
        return [ca.if_else(flag, ca.densify(i), ca.densify(j)) for i, j in pairs]
    shapes = [t.shape for t in then]
    c = ca.SX.sym("c")
    a, b = ([ca.SX.sym("v", *shape) for shape in shapes] for _ in range(2))
    selected = [ca.if_else(c, i, j) for i, j in zip(a, b, strict=True)]
    name = "choose_" + "_".join(str(t.numel()) for t in then)
    return ca.Function(name, [c, *a, *b], selected).call([flag, *then, *otherwise])


def physical(
    s: Setting, *, x: ca.MX, P: ca.MX, u: ca.MX, e: ca.MX, S: ca.MX, flags: ca.MX
) -> dict[str, ca.MX]:
    """Values of `ESTIMATE_CHANNELS` from a scaled posterior.

    Parameters
    ----------
    s : Setting
    x, P : MX
        State (nx,) and lower triangle of its covariance.
    u : MX
        Inputs (nu,) of the sample.
    e, S : MX
        Innovation (ny,) and lower triangle of its covariance.
    flags : MX
        `Flags.vector`.
    """
    if s.model.nx > UNROLL:
        x_hat, y_hat, status = estimate_told(s, x=x, u=u, flags=flags)
        values = [x_hat, triangle(P, s.sx), y_hat]
    else:
        raised = ca.SX.sym("flags", FLAGS)
        k = {n: ca.SX.sym(n, v.numel()) for n, v in {"x": x, "P": P, "u": u}.items()}
        outputs = s.sy * s.model.output(k["x"], k["u"])
        coded = _status_of(s, raised, s.unsolved(k["x"], k["u"]))
        estimate = [*s.physical(k["x"], k["P"]), outputs, coded]
        leave = ca.Function("physical", [k["x"], k["P"], k["u"], raised], estimate)
        *values, status = leave(x, P, u, flags)
    # Apart from the rest: the innovation is known before the sample enters.
    values += physical_innovation(s).call([e, S])
    return {c.name: v for c, v in zip(ESTIMATE_CHANNELS, [*values, status], strict=True)}


def estimate_told(s: Setting, *, x: ca.MX, u: ca.MX, flags: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Physical state and outputs, and the status, of a model of many states; see `physical`."""
    y_hat, _ = seen_outputs(s)(x, u)
    xs, us = ca.SX.sym("x", x.numel()), ca.SX.sym("u", u.numel())
    raised, left = ca.SX.sym("flags", FLAGS), ca.SX.sym("left")
    unsolved = ca.Function("unsolved", [xs, us], [s.unsolved(xs, us)])
    status = ca.Function("status", [raised, left], [_status_of(s, raised, left)])
    return ca.DM(s.sx) * x, ca.DM(s.sy) * y_hat, status(flags, unsolved(x, u))


def _status_of(s: Setting, raised: ca.SX, unsolved: ca.SX) -> ca.SX:
    flags = dataclasses.replace(Flags.of(raised), coarse_step=int(s.coarse), not_solved=unsolved)
    return flags.status()


def physical_innovation(s: Setting) -> ca.Function:
    """Innovation and lower triangle of its covariance in physical units: ``(e, S) -> (e, S)``."""
    ny = s.model.ny
    if ny > UNROLL:
        e, S = ca.MX.sym("e", ny), ca.MX.sym("S", ny * (ny + 1) // 2)
        results = [e * ca.DM(s.sy), triangle(S, s.sy)]
        return ca.Function("physical_innovation", [e, S], results)
    e, S = ca.SX.sym("e", ny), ca.SX.sym("S", ny * (ny + 1) // 2)
    results = [s.sy * e, vech(unvech(S) * ca.SX(np.outer(s.sy, s.sy)))]
    return ca.Function("physical_innovation", [e, S], results)
