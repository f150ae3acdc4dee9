"""A look at the samples: smallest and largest values, piece by piece, and the first one."""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from backsight.data import read
from backsight.data.listing import FileColumns
from backsight.errors import DataError
from backsight.types import Array

PIECES = 160
MOST_COLUMNS = 60
"""Columns that are drawn; a longer list is only listed."""

Band = list[list[float | None]]


@dataclasses.dataclass(frozen=True)
class Preview:
    """A look at a column.

    Parameters
    ----------
    first : float
        The first sample that is measured [as in the file].
    band : list of list
        Smallest and largest values, piece by piece; None where nothing is measured.
    """

    first: float
    band: Band


def previews(found: FileColumns) -> dict[str, Preview]:
    """Column to its preview.

    Columns that cannot be read together are read one by one; one that cannot be read has none.
    """
    names = [column.name for column in found.signals[:MOST_COLUMNS]]
    try:
        return _read(found, names)
    except DataError:
        pass
    drawn: dict[str, Preview] = {}
    for name in names:
        try:
            drawn |= _read(found, [name])
        except DataError:
            continue
    return drawn


def _read(found: FileColumns, names: Sequence[str]) -> dict[str, Preview]:
    recording = read(
        found.path,
        inputs={},
        outputs={name: name for name in names},
        dt=None if found.clock == "" else 1.0,
        missing=found.codes,
    )
    values = recording["y"].to_numpy()
    return {name: _preview(values[:, k]) for k, name in enumerate(names)}


def _preview(values: Array) -> Preview:
    measured = values[np.isfinite(values)]
    return Preview(float(measured[0]) if measured.size else math.nan, _band(values))


def _band(values: Array) -> Band:
    edges = np.linspace(0, len(values), min(PIECES, len(values)) + 1).astype(int)
    pieces = [values[a:b] for a, b in itertools.pairwise(edges)]
    known = [piece[np.isfinite(piece)] for piece in pieces]
    ends = [(float(k.min()), float(k.max())) if k.size else (math.nan, math.nan) for k in known]
    return [[None if math.isnan(v) else v for v in side] for side in zip(*ends, strict=True)]
