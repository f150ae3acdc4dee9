"""What looks wrong in the samples of a channel: codes, clipping, dropouts, lost samples."""

import dataclasses
import re

import numpy as np

from backsight.types import Array

FEW = 20
"""Distinct values up to which a channel is digital or held, so that equal samples mean nothing."""

STUCK, STUCK_BY = 50, 10
"""Equal samples in a row that are worth mentioning: so many, and so many times what is usual."""

CROWDED, FLAT, FEWEST_CLIPPED = 4.0, 3.0, 6
"""A clipped end holds so many times the samples of the next value, in runs of so many on average.

The end of a sine on a coarse grid holds up to 2.5 times the samples of the next step.
"""

FAR = 10.0
"""A code lies so many times the range of all other values away from them."""

SURE = 1.3
"""How much more than by the noise, which is estimated, second differences must vary."""

_NINES = re.compile(r"-?9{3,}(\.9+)?|-?[89]888+")


@dataclasses.dataclass(frozen=True)
class ChannelLook:
    """What the samples of a channel are like.

    Parameters
    ----------
    low, high : float
        Of the measured samples, without codes; NaN if there are none.
    missing : int
        Samples that are not measured, without those between the samples of a slower channel.
    every : int
        The channel has a sample in every such row.
    noise : float
        Standard deviation of what changes from sample to sample without any trend.
    walk : float
        Standard deviation of the change of the difference between neighbours.
    code : float or None
        A value that seems to mean "not measured".
    remarks : tuple of str
        What looks wrong.
    """

    low: float
    high: float
    missing: int
    every: int
    noise: float
    walk: float
    code: float | None
    remarks: tuple[str, ...]


@np.errstate(invalid="ignore", over="ignore")  # of infinite ones
def look(values: Array, dt: float | None) -> ChannelLook:
    """Look at the samples of a channel, (n,); `dt` [s] serves to say times if it is known."""
    known = np.flatnonzero(~np.isnan(values))
    if not known.size:
        return ChannelLook(
            np.nan, np.nan, len(values), 1, np.nan, np.nan, None, ("nothing is measured",)
        )
    measured = values[known]
    code = _code(measured)
    remarks = []
    if code is not None:
        times = int(np.sum(measured == code))
        count = "one sample" if times == 1 else f"{times} samples"
        remarks.append(f"{code:g} in {count}: not measured? (missing = [{code:g}])")
        known = known[measured != code]
        measured = values[known]
    if not known.size:
        return ChannelLook(np.nan, np.nan, len(values), 1, np.nan, np.nan, code, tuple(remarks))
    low, high = float(measured.min()), float(measured.max())
    every = _every(known, len(values))
    if low == high:
        remarks.append("constant")
    else:
        remarks += _clipped(measured, low, high) + _stuck(measured, known, low, high, dt)
    missing = 0 if every > 1 else len(values) - len(known)
    if missing:
        remarks += _dropouts(known, len(values), dt)
    # A power of two changes no digit, and squares of large numbers do not overflow.
    unit = 2.0 ** (np.frexp(np.abs(measured).max())[1] - 1)
    noise = unit * _noise(measured / unit)
    walk = unit * _walk(measured / unit, noise / unit)
    return ChannelLook(low, high, missing, every, noise, walk, code, tuple(remarks))


def _noise(values: Array) -> float:
    """Standard deviation of white noise on a signal that is smooth over four samples.

    Third differences take out what is a parabola; white noise remains with the factor sqrt(20). The
    median does not see steps. Of a signal that is as fast as the sampling it is an upper bound.
    """
    if len(values) < 8:
        return float("nan")
    return float(1.4826 * np.median(np.abs(np.diff(values, 3))) / np.sqrt(20.0))


def _walk(values: Array, noise: float) -> float:
    """Change of the slope per sample that explains what noise does not.

    A second difference over m samples has the variance 6 r + q (2 m^3 + m) / 3 with the variances r
    of white noise and q of the change of slope. Of several m the largest q: slow motion shows over
    many samples, fast over one.
    """
    found = 0.0
    for m in (1, 4, 16):
        if len(values) > 4 * m:
            second = values[2 * m :] - 2 * values[m:-m] + values[: -2 * m]
            rest = float(np.mean(second**2)) - SURE * 6.0 * (0.0 if np.isnan(noise) else noise**2)
            found = max(found, rest / ((2 * m**3 + m) / 3))
    return float(np.sqrt(found))


def _code(values: Array) -> float | None:
    """A value far from all others that is there more than once, or one of nines."""
    for end in (float(values.min()), float(values.max())):
        rest = values[values != end]
        times = len(values) - len(rest)
        if not rest.size:
            return end if _NINES.fullmatch(f"{end:g}") else None
        if np.ptp(rest) == 0.0 and not _NINES.fullmatch(f"{end:g}"):
            continue  # a switch has two values
        away = min(abs(end - float(rest.min())), abs(end - float(rest.max())))
        spread = float(np.ptp(rest)) or abs(float(rest[0]))
        if away > FAR * spread and (times > 2 or _NINES.fullmatch(f"{end:g}")):
            return end
    return None


def _every(known: np.ndarray, rows: int) -> int:
    """How many rows there are per sample, if the channel is slower than the others."""
    if len(known) < 3 or len(known) == rows:
        return 1
    steps = np.diff(known)
    step = int(steps[0])
    return step if step > 1 and (steps == step).all() else 1


def _runs(same: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First places and lengths of the runs of True."""
    edges = np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))
    first, after = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return first, after - first


def _clipped(values: Array, low: float, high: float) -> list[str]:
    names = {low: "minimum", high: "maximum"}
    return [
        f"clipped? {n} samples at the {names[e]} {e:g}" for e, n in clipped_ends(values).items()
    ]


def clipped_ends(values: Array) -> dict[float, int]:
    """Smallest and largest value of samples (n,), if it is that of a clipped signal, and how often.

    A signal with few distinct values is digital or held, and not clipped.
    """
    if not values.size or (
        np.unique(values[: 100 * FEW]).size <= FEW and np.unique(values).size <= FEW
    ):
        return {}
    low, high, found = float(values.min()), float(values.max()), {}
    for end in (low, high):
        at = values == end
        times = int(at.sum())
        if times < FEWEST_CLIPPED:
            continue
        rest = values[~at]
        beside = float(rest.min() if end == low else rest.max())
        _, lengths = _runs(at)
        if times > CROWDED * int(np.sum(values == beside)) and lengths.mean() >= FLAT:
            found[end] = times
    return found


def _stuck(
    values: Array, known: np.ndarray, low: float, high: float, dt: float | None
) -> list[str]:
    first, lengths = _runs(np.diff(values) == 0)
    if not lengths.size:
        return []
    k = int(np.argmax(lengths))
    usual = float(np.percentile(lengths, 95)) if lengths.size > 20 else 1.0
    longest = int(lengths[k]) + 1
    value = float(values[first[k]])
    if longest < max(STUCK, STUCK_BY * usual) or value in (low, high):
        return []
    return [f"stuck? {longest} samples in a row are {value:g}, {_when(int(known[first[k]]), dt)}"]


def _dropouts(known: np.ndarray, rows: int, dt: float | None) -> list[str]:
    remarks = []
    if known[0] > 0:
        remarks.append(f"begins {_when(int(known[0]), dt)}")
    if known[-1] < rows - 1:
        remarks.append(
            f"ends {_when(int(known[-1]), dt).replace('from', 'after').replace(' on', '')}"
        )
    there = np.zeros(rows, bool)
    there[known] = True
    first, lengths = _runs(~there[known[0] : known[-1] + 1])
    if not lengths.size:
        return remarks
    first += known[0]
    k = int(np.argmax(lengths))
    longest = f"{lengths[k]} rows" if dt is None else f"{lengths[k] * dt:.4g} s"
    count = "one gap" if len(lengths) == 1 else f"{len(lengths)} gaps, the longest"
    return [*remarks, f"{count} of {longest}, {_when(int(first[k]), dt)}"]


def _when(row: int, dt: float | None) -> str:
    return f"from row {row} on" if dt is None else f"from {row * dt:.6g} s on"
