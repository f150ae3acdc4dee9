"""Dictionaries: of which atoms an unknown force is made."""

import abc
import dataclasses

import numpy as np

from backsight.errors import TuningError
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class AbstractDictionary(abc.ABC):
    r"""Atoms that begin at every step of the window.

    The forces over the steps, held between the samples, are
    :math:`d_k = \sum_s \Psi_s \alpha_{k-s}`.
    """

    @abc.abstractmethod
    def shapes(self, forces: int) -> Array:
        """Psi as an array (forces, steps, atoms).

        Raises
        ------
        TuningError
            If the dictionary is not one for so many forces.
        """

    def force_of(self, forces: int) -> list[int]:
        """Which force every atom belongs to; -1 if it moves several."""
        touched = np.abs(self.shapes(forces)).max(axis=1) > 0
        alone = touched.sum(axis=0) == 1
        return np.where(alone, touched.argmax(axis=0), -1).tolist()


@dataclasses.dataclass(frozen=True)
class Impulses(AbstractDictionary):
    """Every force at every step by itself: short hits, the identity as dictionary."""

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
    """

    widths: tuple[int, ...] = (2,)

    def __post_init__(self) -> None:
        if not self.widths or any(w != int(w) or w < 1 for w in self.widths):
            raise TuningError(f"widths is {self.widths}; give whole numbers of samples from 1 on")
        object.__setattr__(self, "widths", tuple(int(w) for w in self.widths))

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
    """

    matrix: Array

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, float)
        if matrix.ndim not in (2, 3) or not matrix.size or not np.isfinite(matrix).all():
            raise TuningError(
                f"the dictionary has the shape {matrix.shape}; give (forces, atoms) or (forces, "
                "steps, atoms) finite numbers"
            )
        empty = ~np.abs(matrix).reshape(-1, matrix.shape[-1]).max(axis=0).astype(bool)
        if empty.any():
            raise TuningError(f"atom {int(np.argmax(empty))} of the dictionary is zero; remove it")
        object.__setattr__(self, "matrix", matrix)

    def shapes(self, forces: int) -> Array:
        """See `AbstractDictionary.shapes`."""
        if len(self.matrix) != forces:
            raise TuningError(
                f"the dictionary has {len(self.matrix)} rows; {forces} forces need {forces}"
            )
        return self.matrix if self.matrix.ndim == 3 else self.matrix[:, np.newaxis, :]
