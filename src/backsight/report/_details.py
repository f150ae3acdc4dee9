"""What zooming in brings out: every sample of long lines, packed until somebody asks for it.

A page has room for so many bytes. What does not fit is thinned to the smallest and largest of
every few samples, never cut.
"""

import base64
import dataclasses
import math
import zlib
from collections.abc import Sequence
from typing import Literal

import numpy as np

from backsight.report.thin import Positions
from backsight.types import Array

PAGE, ROOM = 2_300_000, 1_200_000
"""Bytes of a page, and of all details as they stand in it, at most."""

_MISSING = 2**16 - 1  # as a code; the others are the numbers of equal steps
_STEPS = 1000  # as fine as this must the bulk of a line be, to be kept in two bytes
_LETTERS = 4 / 3  # bytes of a text for a byte


@dataclasses.dataclass(frozen=True, eq=False)
class Detail:
    """All samples of what is drawn thinned.

    Parameters
    ----------
    kind : str
        A line, a band between two limits, or two lines at plus and minus a limit.
    values : tuple of (n,) array
        One column, of a band the lower and the upper limit.
    start, step : float
        Time of the first sample and between two.
    gaps : array of int
        Samples at which a line is interrupted; other missing samples are passed over.
    """

    kind: Literal["line", "band", "limits"]
    values: tuple[Array, ...]
    start: float
    step: float
    gaps: Positions

    @property
    def cost(self) -> float:
        """Bytes on the page, about."""
        return _LETTERS * sum(len(zlib.compress(_coded(v).raw, 1)) for v in self.values)

    def packed(self, every: int) -> dict[str, object]:
        """As JSON, thinned to two values of `every` samples (of a band one; 1: all of them)."""
        values, stride = self._thinned(every) if every > 1 else (self.values, 1)
        return {
            "kind": self.kind,
            "start": self.start,
            "step": self.step * stride,
            "gaps": [int(k // stride) for k in self.gaps],
            "values": [_coded(v).as_json() for v in values],
        }

    def _thinned(self, every: int) -> tuple[tuple[Array, ...], float]:
        rows = [_rows(v, every) for v in self.values]
        if self.kind == "band":
            return (_extreme(np.fmin, rows[0]), _extreme(np.fmax, rows[1])), every
        low, high = _extreme(np.fmin, rows[0]), _extreme(np.fmax, rows[0])
        rising = np.nan_to_num(rows[0][:, -1] - rows[0][:, 0]) >= 0
        pairs = np.where(rising[:, np.newaxis], np.c_[low, high], np.c_[high, low])
        return (pairs.ravel(),), every / 2


def thinning(details: Sequence[Detail], rest: int) -> int:
    """Samples of which two values are kept so that all details fit; 1 if all of them do.

    The `rest` of the page has so many bytes.
    """
    ratio = sum(d.cost for d in details) / min(ROOM, max(PAGE - rest, 1))
    return 1 if ratio <= 1.0 else 2 * math.ceil(ratio)


def _rows(values: Array, every: int) -> Array:
    filled = np.full(-(-len(values) // every) * every, np.nan)
    filled[: len(values)] = values
    return filled.reshape(-1, every)


def _extreme(of: np.ufunc, rows: Array) -> Array:
    return of.reduce(np.where(np.isfinite(rows), rows, np.nan), axis=1)


@dataclasses.dataclass(frozen=True)
class _Coded:
    """A column as bytes: ``f4``, or numbers of equal steps ``unit`` from ``low`` on, ``u2``.

    Of the latter the differences from sample to sample are kept, modulo 2**16, all low bytes before
    all high ones: of a smooth line nearly all of them are the same, which packs well.
    """

    dtype: Literal["u2", "f4"]
    raw: bytes
    low: float = 0.0
    unit: float = 0.0

    def as_json(self) -> dict[str, object]:
        text = base64.b64encode(self.raw).decode("ascii")
        return {"dtype": self.dtype, "bdata": text, "low": self.low, "unit": self.unit}


def _coded(values: Array) -> _Coded:
    with np.errstate(over="ignore"):  # what is too large for a page is not shown
        single = values.astype("<f4")
    finite = np.isfinite(single)
    if not _even(values[finite]):
        return _Coded("f4", np.where(finite, single, np.float32(np.nan)).tobytes())
    low = float(values[finite].min()) if finite.any() else 0.0
    unit = float(np.ptp(values[finite])) / (_MISSING - 1) if finite.any() else 0.0
    steps = np.rint((np.where(finite, values, low) - low) / (unit or 1.0))
    codes = np.where(finite, steps, _MISSING).astype("<u2")
    changes = np.diff(codes, prepend=codes.dtype.type(0))
    return _Coded("u2", changes.view(np.uint8).reshape(-1, 2).T.tobytes(), low, unit)


def _even(finite: Array) -> bool:
    """Whether equal steps over the whole range are fine for where most samples are."""
    if not finite.size:
        return True
    low, high = np.quantile(finite, [0.1, 0.9])
    return bool(np.ptp(finite) * _STEPS <= (high - low) * (_MISSING - 1))
