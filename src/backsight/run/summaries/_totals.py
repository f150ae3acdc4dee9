"""A recursion that accumulates what a summary needs in its own memory, and puts out nothing."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.algebra.factor import ldl
from backsight.engine.recursion import Recursion
from backsight.estimators.outliers import DOUBTED
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import ABSURD, HUGE
from backsight.schema import WEIGHT, Status
from backsight.types import Array

BITS = tuple(bit for bit in Status if bit)
"""The status bits in the order in which they are counted."""

LARGEST_NIS = 1e100
"""A larger NIS counts as this, as in `backsight.analysis.consistency`."""

NEVER = -1.0
"""Number of the sample that failed first, of a recording on which nothing failed."""


@dataclasses.dataclass(frozen=True)
class Totals:
    """The memory behind that of an estimator: sizes of its parts by name.

    Parameters
    ----------
    nx, ny : int
        Numbers of states and outputs.
    lag : int
        The outputs of a step are about the sample so many steps ago; y and mask wait for them.
    """

    nx: int
    ny: int
    lag: int

    @property
    def sizes(self) -> dict[str, int]:
        """Name of every part to its size, in order."""
        return {
            "waiting": 2 * self.ny * self.lag,
            "largest": self.ny,
            "steps": 1,
            "with_nis": 1,
            "channels": 1,
            "nis": 1,
            "log_likelihood": 1,
            "measured": self.ny,
            "squares": self.ny,
            "x_last": self.nx,
            "std_last": self.nx,
            "x_sum": self.nx,
            "finite": self.nx,
            "bits": len(BITS),
            "failed_at": 1,
        }

    def begin(self, inside: Array, largest: Array) -> Array:
        """Memory before the first sample.

        Parameters
        ----------
        inside : array
            That of the estimator.
        largest : (ny,) array
            Size of every output in the whole recording.
        """
        parts = {name: np.zeros(size) for name, size in self.sizes.items()}
        parts |= {"largest": largest, "failed_at": np.array([NEVER])}
        return np.concatenate([inside, *parts.values()])

    def enlarged(self, memory: Array, largest: Array) -> Array:
        """Memory that knows of larger outputs, (ny,)."""
        changed = memory.copy()
        parts = self.split(changed)  # views
        np.maximum(parts["largest"], largest, out=parts["largest"])
        return changed

    def split(self, memory: Array) -> dict[str, Array]:
        """The parts of a memory by name."""
        sizes = self.sizes
        ends = np.cumsum(list(sizes.values()))[:-1]
        return dict(zip(sizes, np.split(memory[-sum(sizes.values()) :], ends), strict=True))


def totalling(
    recursion: Recursion, model: Model, *, outputs: bool = False
) -> tuple[Recursion, Totals]:
    """The same steps with totals, of which nothing else is left unless `outputs` are kept, too.

    Parameters
    ----------
    recursion : Recursion
        ``(carry, u, y, mask)`` with the channels of every estimator; see `putting_out`, which makes
        ``x_std`` and ``e_std`` of covariances.
    model : Model
    outputs : bool
        Whether to put out what `recursion` does.

    Returns
    -------
    Recursion
        Its outputs are those of `recursion`, or none. Where it begins depends on the recording, see
        `Totals.begin`.
    Totals
        What is in that memory.
    """
    sizes = {c.name: n for c, n in zip(recursion.channels, recursion.output_sizes, strict=True)}
    totals = Totals(sizes["x_hat"], recursion.input_sizes[1], recursion.lag)
    kept = len(recursion.carry0)
    carry = ca.MX.sym("carry", kept + sum(totals.sizes.values()))
    u, y, mask = (ca.MX.sym(n, k) for n, k in zip("uym", recursion.input_sizes, strict=True))
    ends = np.cumsum([0, kept, *totals.sizes.values()]).tolist()
    inside, *parts = ca.vertsplit(carry, ends)
    after, *values = recursion.step.call([inside, u, y, mask], True, False)
    given = dict(zip(totals.sizes, parts, strict=True))
    # The newest goes in behind, the one that the outputs are about comes out in front.
    queue = ca.vertcat(given["waiting"], y, mask)
    about, waiting = queue[: 2 * totals.ny], queue[2 * totals.ny :]
    seen = dict(zip(sizes, values, strict=True))
    function = _taken_in(
        totals, model.outputs, {name: sizes[name] for name in USED if name in sizes}
    )
    changed = function(
        *(v for k, v in given.items() if k != "waiting"),
        *(seen[name] for name in USED if name in seen),
        about,
    )
    results = values if outputs else []
    moved = ca.vertcat(after, waiting, *changed)
    step = ca.Function(recursion.name, [carry, u, y, mask], [moved, *results])
    carry0 = totals.begin(recursion.carry0, np.zeros(totals.ny))
    channels = recursion.channels if outputs else ()
    made = {"step": step, "carry0": carry0, "channels": channels, "start": None}
    return dataclasses.replace(recursion, **made), totals


def largest(data: Sequence[Array]) -> Array:
    """Largest size of every output that was measured, (ny,), of ``(u, y, mask)``."""
    _, y, _ = data  # zero where not measured
    return np.maximum(y.max(axis=0, initial=0.0), -y.min(axis=0, initial=0.0))


USED = ("x_hat", "x_std", "y_hat", "e", "e_std", "S", "status", WEIGHT)
"""What the totals are made of; the weight only of an estimator with a rule for outliers."""


def _taken_in(totals: Totals, signals: Sequence[Signal], sizes: Mapping[str, int]) -> ca.Function:
    """``(totals, values of a sample, its y and mask) -> totals``."""
    before = {n: ca.SX.sym(n, k) for n, k in totals.sizes.items() if n != "waiting"}
    now = {name: ca.SX.sym(f"of_{name}", size) for name, size in sizes.items()}
    about = ca.SX.sym("about", 2 * totals.ny)
    y, mask = about[: totals.ny], about[totals.ny :]
    y = ca.vertcat(*(_near(y[i], now["y_hat"][i], s.wrap) for i, s in enumerate(signals)))
    # No sensor measures a dummy.
    mask = mask * ca.DM([float(s.dummy is None) for s in signals])
    # The first outputs of an estimator that looks back are about no sample.
    counts = before["steps"] >= totals.lag
    seen = ca.logic_and(mask > 0, counts)
    taken = ca.logic_and(seen, now[WEIGHT] >= DOUBTED) if WEIGHT in now else seen
    squares, log_det, usable = _whitened(now["e"], now["S"], taken)
    channels = ca.sum1(taken)
    likelihood = -0.5 * (squares + log_det + channels * math.log(2.0 * math.pi))
    usable = ca.logic_and(usable, counts)
    lost = ca.logic_and(_lost(now, y, mask > 0, before["largest"]), counts)
    bits = _bits(now["status"], lost)
    first = ca.logic_and(before["failed_at"] < 0, bits[BITS.index(Status.NOT_FINITE)])
    known = ca.logic_and(taken, ca.fabs(now["e"]) < np.inf)
    finite = ca.logic_and(ca.fabs(now["x_hat"]) < np.inf, counts)
    e = ca.if_else(known, now["e"], 0)
    after = before | {
        "steps": before["steps"] + 1,
        "with_nis": before["with_nis"] + usable,
        "channels": before["channels"] + ca.if_else(usable, channels, 0),
        "nis": before["nis"] + ca.if_else(usable, squares, 0),
        "log_likelihood": before["log_likelihood"] + ca.if_else(usable, likelihood, 0),
        "measured": before["measured"] + known,
        "squares": before["squares"] + e**2,
        "x_last": now["x_hat"],
        "std_last": now["x_std"],
        "x_sum": before["x_sum"] + ca.if_else(finite, now["x_hat"], 0),
        "finite": before["finite"] + finite,
        "bits": before["bits"] + ca.if_else(counts, bits, 0),
        "failed_at": ca.if_else(
            ca.logic_and(first, counts), before["steps"] - totals.lag, before["failed_at"]
        ),
    }
    return ca.Function("take_in", [*before.values(), *now.values(), about], [*after.values()])


def _near(y: ca.SX, estimate: ca.SX, wrap: float | None) -> ca.SX:
    """An angle with the turns that bring it near to its estimate."""
    return y if wrap is None else y + wrap * ca.floor((estimate - y) / wrap + 0.5)


def _whitened(e: ca.SX, whole: ca.SX, taken: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """e' S^-1 e, ln det S over the outputs taken, and whether these can be told.

    As in `backsight.analysis.consistency`: an output that is not taken is an independent one with
    unit variance and zero innovation; S is brought to unit diagonal first.
    """
    n = e.numel()
    S = ca.reshape(whole, n, n)
    z = ca.if_else(taken, e, 0)
    variance = ca.if_else(taken, ca.diag(S), 1)
    scale = ca.sqrt(variance)
    C = ca.SX.eye(n)
    for i in range(n):
        for j in range(i):
            both = ca.logic_and(taken[i], taken[j])
            C[i, j] = C[j, i] = ca.if_else(both, S[i, j], 0) / scale[i] / scale[j]
    L, d = ldl(C)
    white: list[ca.SX] = []
    for i in range(n):
        done = sum((L[i, j] * white[j] for j in range(i)), ca.SX(0))
        white.append(z[i] / scale[i] - done)
    squares = ca.sum1(ca.vertcat(*white) ** 2 / d)
    # NaN is neither below a limit nor above zero.
    fine = ca.mmin(ca.vertcat(ca.fabs(z) < np.inf, variance > 0, variance < np.inf, d > 0))
    log_det = ca.sum1(ca.log(d) + ca.log(variance))
    usable = ca.logic_and(ca.sum1(taken) > 0, fine)
    return ca.if_else(squares < LARGEST_NIS, squares, LARGEST_NIS), log_det, usable


def _lost(now: Mapping[str, ca.SX], y: ca.SX, measured: ca.SX, largest: ca.SX) -> ca.SX:
    """Whether the estimator has diverged, as `looked_at` tells it of results."""
    small = [ca.fabs(now[name]) < HUGE for name in ("x_hat", "y_hat")]
    small += [now[name] < HUGE**0.5 for name in ("x_std", "e_std")]
    sound = ca.mmin(ca.vertcat(*small))
    off = ca.if_else(measured, ca.fabs(now["y_hat"] - y), 0)
    beyond = ca.mmax(off > ABSURD * ca.fmax(now["e_std"], largest))
    return ca.logic_or(ca.logic_not(sound), beyond)


def _bits(status: ca.SX, lost: ca.SX) -> ca.SX:
    """Which bits are raised, (bits,) of 0 or 1."""
    told = ca.if_else(ca.fabs(status) < np.inf, status, 0)
    raised = []
    for bit in BITS:
        half = ca.floor(told / int(bit))
        here = half - 2 * ca.floor(half / 2)
        raised.append(ca.logic_or(here, lost) if bit == Status.NOT_FINITE else here)
    return ca.vertcat(*raised)
