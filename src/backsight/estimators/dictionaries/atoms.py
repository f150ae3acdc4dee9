"""The dictionary of atoms that the user gives."""

import dataclasses
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from backsight.description import Called, Sound
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.types import Array


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
