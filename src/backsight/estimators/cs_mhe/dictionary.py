"""Dictionaries: of which atoms an unknown force is made."""

import dataclasses
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from backsight.description import Called, Count, Distinct, Sound
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Impulses(AbstractDictionary):
    """Every force at every step by itself: short hits, the identity as dictionary.

    Examples
    --------
    >>> bs.forces.Impulses()
    Impulses()
    """

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`."""
        return np.eye(forces)[:, np.newaxis, :]


@dataclasses.dataclass(frozen=True)
class HalfSines(AbstractDictionary):
    """Half-sine pulses of the height 1, as of a hammer, at every force.

    Parameters
    ----------
    widths : tuple of int
        Durations in sampling periods; pulses of all of them are offered.

    Examples
    --------
    >>> bs.forces.HalfSines(widths=(2, 4)).widths
    (2, 4)
    """

    widths: Annotated[tuple[Count, ...], Distinct()] = (2,)

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("widths") and not self.widths:
            yield "widths is (); give whole numbers of samples from 1 on"

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`."""
        pulses = np.zeros((forces, max(self.widths), len(self.widths), forces))
        for i, width in enumerate(self.widths):
            pulse = np.sin(np.pi * (np.arange(width) + 0.5) / width)
            pulses[:, :width, i, :] = pulse[:, np.newaxis] * np.eye(forces)[:, np.newaxis, :]
        return pulses.reshape(forces, max(self.widths), -1)


@dataclasses.dataclass(frozen=True)
class Atoms(AbstractDictionary):
    """Atoms of the user's own.

    Parameters
    ----------
    matrix : (forces, atoms) or (forces, steps, atoms) array
        One column per atom: how large each force is, over one step or over several.

    Examples
    --------
    >>> import numpy as np
    >>> bs.forces.Atoms(np.eye(4)).matrix.shape
    (4, 4)
    """

    matrix: Annotated[Array, Called("the dictionary")]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "matrix", np.asarray(self.matrix, float))

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("matrix"):
            return
        matrix = np.asarray(self.matrix, float)
        if matrix.ndim not in (2, 3) or not matrix.size:
            yield (
                f"the dictionary has the shape {matrix.shape}; give (forces, atoms) or (forces, "
                "steps, atoms) finite numbers"
            )
            return
        empty = ~np.abs(matrix).reshape(-1, matrix.shape[-1]).max(axis=0).astype(bool)
        if empty.any():
            yield f"atom {int(np.argmax(empty))} of the dictionary is zero; remove it"

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`."""
        if len(self.matrix) != forces:
            raise TuningError(
                f"the dictionary has {len(self.matrix)} rows; {forces} forces need {forces}"
            )
        return self.matrix if self.matrix.ndim == 3 else self.matrix[:, np.newaxis, :]
