"""The search for sparse forces over a whole recording, as a regression on atoms."""

import dataclasses

import numpy as np
import psutil

from backsight.errors import DataError
from backsight.estimators.force_estimator import Forced
from backsight.sparse._matrices import MatricesInTime, linear_matrices
from backsight.sparse._whitened import Whitened, whitened
from backsight.sparse.regression import Indices, Regression
from backsight.types import Array

SEEN = 1e-9
"""An atom whose response is shorter than this share of the longest is not seen at all."""

ROOM = 0.5
"""Share of the free memory that the responses may take."""


@dataclasses.dataclass(frozen=True)
class ForceSearch:
    """Atoms at all steps of a recording, and what they explain of it.

    Parameters
    ----------
    filter : Whitened
    shapes : (forces, steps, atoms) array
        The dictionary.
    regression : Regression
        White innovations without forces, and the response of every atom that is seen.
    step, atom : (columns,) arrays
        Where the columns begin, and which atom of the dictionary they are.
    lam : float
        Weight of the l1 norm, for those who have one.
    threshold : float
        Smallest factor that counts.
    """

    filter: Whitened
    shapes: Array
    regression: Regression
    step: Indices
    atom: Indices
    lam: float
    threshold: float

    @property
    def samples(self) -> int:
        """Samples of the recording."""
        return len(self.filter.y)

    def measuring(self, y: Array) -> "ForceSearch":
        """Search in other measurements (n, ny) of the same sensors at the same samples."""
        scaled = np.where(self.filter.mask > 0, y / self.filter.forced.system.s.sy, 0.0)
        filtered = dataclasses.replace(self.filter, y=scaled)
        quiet = filtered.innovations(np.zeros((self.samples, len(self.shapes)))).ravel()
        regression = dataclasses.replace(self.regression, target=quiet)
        return dataclasses.replace(self, filter=filtered, regression=regression)

    def pulses(self, which: Indices) -> Array:
        """Forces (n, nf, columns) of the chosen columns, each with the factor one."""
        nf, width, _ = self.shapes.shape
        d = np.zeros((self.samples + width, nf, len(which)))
        for i, column in enumerate(which):
            begin = self.step[column]
            d[begin : begin + width, :, i] = self.shapes[:, :, self.atom[column]].T
        return d[: self.samples]

    def forces(self, which: Indices, values: Array) -> Array:
        """Forces (n, nf) of the chosen columns with their factors."""
        return self.pulses(which) @ values


def force_search(
    forced: Forced,
    data: tuple[Array, Array, Array],
    *,
    shapes: Array,
    side: Array,
    lam: float,
    threshold: float,
    matrices: MatricesInTime | None = None,
) -> ForceSearch:
    """Filter a recording and work out the responses.

    Parameters
    ----------
    forced : Forced
    data : tuple of arrays
        Inputs, outputs and mask, physical.
    shapes : (forces, steps, atoms) array
    side : (atoms,) array
        See `Regression`.
    lam, threshold : float
        See `ForceSearch`.
    matrices : MatricesInTime, optional
        The model at every sample; that of a linear model if not given.

    Raises
    ------
    DataError
        If the responses would not fit into memory.
    """
    n, ny = data[1].shape
    atoms = shapes.shape[2]
    needed = 8.0 * n * ny * n * (shapes.shape[0] + 2 * atoms)
    if needed > ROOM * psutil.virtual_memory().available:
        raise DataError(
            f"the responses to {atoms} atoms at each of {n} samples would take "
            f"{needed / 1e9:.1f} GB of memory; cut the recording, or take a moving window"
        )
    (u, y, mask), s = data, forced.system.s
    if matrices is None:
        matrices = linear_matrices(forced, u / s.su[: forced.nu])
    filtered = whitened(forced, matrices, y / s.sy, mask)
    units = filtered.responses()
    columns = np.zeros((n, ny, n, atoms))
    for s in range(min(shapes.shape[1], n)):
        columns[:, :, : n - s] += units[:, :, s:] @ shapes[:, s]
    columns = columns.reshape(n * ny, n * atoms)
    lengths = np.linalg.norm(columns, axis=0)
    kept = np.flatnonzero(lengths > SEEN * lengths.max(initial=0.0))
    quiet = filtered.innovations(np.zeros((n, len(forced.names)))).ravel()
    regression = Regression(columns[:, kept], quiet, side[kept % atoms])
    return ForceSearch(filtered, shapes, regression, kept // atoms, kept % atoms, lam, threshold)
