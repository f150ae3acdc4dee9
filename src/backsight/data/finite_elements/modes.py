"""Natural frequencies, damping and mode shapes of modal tests and finite-element programs."""

import dataclasses
import os
import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from backsight.data._room import check_room
from backsight.data.finite_elements._rows import number_in, rows_of
from backsight.data.finite_elements.matrix import place_name
from backsight.data.formats.libraries import library
from backsight.errors import BacksightWarning, DataError, nearest

_COMPLEX = 0.1
"""A larger share of a shape that is out of phase is said."""

_UFF = re.compile(rb"\s*-1\s*\r?\n\s*(15|55|58b?|82|151|164|2411)\b")


@dataclasses.dataclass(frozen=True)
class ModeShapes:
    """Modes of a structure at some coordinates.

    Parameters
    ----------
    frequencies : (m,) array
        [Hz].
    damping : (m,) array or None
        Ratios to critical damping, if the file has them.
    modal_masses : (m,) array or None
        Of the shapes as they are scaled, if the file has them.
    coordinates : tuple of str
        Names, ``"node:direction"``.
    shapes : (n, m) array
        Deflections.
    """

    frequencies: np.ndarray
    damping: np.ndarray | None
    modal_masses: np.ndarray | None
    coordinates: tuple[str, ...]
    shapes: np.ndarray

    def at(self, place: str | Mapping[str, float]) -> np.ndarray:
        """Shapes (m,) at a coordinate, or a weighted sum; raises `DataError` if it is not there."""
        weights = {place: 1.0} if isinstance(place, str) else place
        row = np.zeros(len(self.frequencies))
        for name, weight in weights.items():
            if name not in self.coordinates:
                hint = nearest(name, self.coordinates)
                raise DataError(f"there is no coordinate '{name}': {hint}")
            row = row + weight * self.shapes[self.coordinates.index(name)]
        return row


def read_modes(path: str | os.PathLike[str]) -> ModeShapes:
    """Read modes: a universal file (data sets 55) or a table.

    In a table each column behind the first is a mode: rows ``frequency`` [Hz] and, if known,
    ``damping`` (or ``damping %``) and ``modal mass``, then a row for every coordinate.

    Parameters
    ----------
    path : path
        The file. Universal files need the library pyuff, ``pip install 'backsight[formats]'``.

    Raises
    ------
    DataError
        If the file cannot be read or has no modes.

    Warns
    -----
    BacksightWarning
        If a shape is complex by more than 10 %; what is in phase is kept.
    """
    file = Path(path)
    try:
        check_room(4 * file.stat().st_size, f"'{file}'")
        with file.open("rb") as stream:
            universal = _UFF.match(stream.read(4096))
    except OSError as error:
        raise DataError(f"cannot read '{file}': {error.strerror}") from None
    return _universal(file) if universal else _table(file)


def _universal(file: Path) -> ModeShapes:
    content = library("pyuff").UFF(str(file))
    kinds = [int(kind) for kind in content.get_set_types()]
    sets = [content.read_sets(k) for k, kind in enumerate(kinds) if kind == 55]
    modes = [s for s in sets if int(s.get("analysis_type", 0)) in (2, 3, 7)]
    if not modes:
        raise DataError(f"{file} has no modes (data sets 55 of normal or complex modes)")
    rows: dict[str, dict[int, complex]] = {}
    for m, mode in enumerate(modes):
        for name, value in _at_nodes(mode):
            rows.setdefault(name, {})[m] = value
    shapes = np.array([[row.get(m, 0.0) for m in range(len(modes))] for row in rows.values()])
    frequencies, damping = zip(*map(_pole, modes), strict=True)
    masses = [float(mode.get("modal_m", 0.0) or 0.0) for mode in modes]
    return ModeShapes(
        np.array(frequencies),
        np.array(damping) if any(damping) else None,
        np.array(masses) if all(m > 0 for m in masses) else None,
        tuple(rows),
        _in_phase(shapes, file),
    )


def _at_nodes(mode: Mapping[str, Any]) -> Iterable[tuple[str, complex]]:
    """Values of a data set at its coordinates; where three are given they are translations."""
    count = int(mode["n_data_per_node"])
    for k in range(count):
        for node, value in zip(mode["node_nums"], mode[f"r{k + 1}"], strict=True):
            yield place_name(int(node), k + 1 if count > 1 else 0), complex(value)


def _pole(mode: Mapping[str, Any]) -> tuple[float, float]:
    """Frequency [Hz] and ratio; structural damping is half its loss factor."""
    if "eig" in mode and int(mode["analysis_type"]) != 2:
        size = abs(complex(mode["eig"]))
        return size / (2 * np.pi), -complex(mode["eig"]).real / size
    viscous = float(mode.get("modal_damp_vis", 0.0) or 0.0)
    loss = float(mode.get("modal_damp_his", 0.0) or 0.0)
    return float(mode["freq"]), viscous or loss / 2


def _in_phase(shapes: Any, file: Path) -> np.ndarray:
    """Real shapes: every one is turned until it is as real as it can be."""
    turned: Any = shapes * np.exp(-0.5j * np.angle((shapes**2).sum(axis=0)))
    share = np.linalg.norm(turned.imag, axis=0) / np.linalg.norm(turned, axis=0)
    if share.max() > _COMPLEX:
        worst = int(share.argmax())
        warnings.warn(
            f"{file}: the shape of mode {worst + 1} is complex, {100 * share[worst]:.0f} % of it "
            "out of phase; what is in phase is kept",
            BacksightWarning,
            stacklevel=3,
        )
    # The sign that most of the shape has in the file.
    sign = np.where((turned.real * shapes.real).sum(axis=0) < 0, -1.0, 1.0)
    return turned.real * sign


def _table(file: Path) -> ModeShapes:
    rows = rows_of(file)
    first, *columns = rows[0]
    found = {
        row[first]: np.array([number_in(row, c, f"{file}, row {k}") for c in columns])
        for k, row in enumerate(rows, 2)
    }
    keyed = {_key(name): values for name, values in found.items()}
    if "frequency" not in keyed:
        raise DataError(f"{file} has no row 'frequency'; the modes are its columns")
    special = {"frequency", "damping", "damping %", "modal mass"}
    places = {name: row for name, row in found.items() if _key(name) not in special}
    if not places:
        raise DataError(f"{file} has no row of shapes")
    percent = keyed.get("damping %")
    return ModeShapes(
        keyed["frequency"],
        keyed.get("damping") if percent is None else percent / 100,
        keyed.get("modal mass"),
        tuple(places),
        np.array(list(places.values())),
    )


def _key(name: str) -> str:
    word = name.lower().replace("_", " ")
    if word.startswith("freq"):
        return "frequency"
    if word.startswith("damping"):
        return "damping %" if "%" in word else "damping"
    return "modal mass" if word.startswith(("modal mass", "mass")) else word
