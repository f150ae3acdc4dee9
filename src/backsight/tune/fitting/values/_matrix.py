r"""Covariances that are free entry by entry, and stay covariances wherever the search goes.

A block of n signals has n variances and n (n - 1) / 2 partial correlations :math:`z_{ij}`, of i and
j given all before j, each between -1 and 1 whatever the others are. The Cholesky factor of the
correlation follows row by row,

.. math:: L_{ij} = z_{ij} \sqrt{1 - \sum_{k<j} L_{ik}^2}, \qquad
    L_{ii} = \sqrt{1 - \sum_{k<i} L_{ik}^2},

and in the first column partial correlations are correlations.

References
----------
Lewandowski, Kurowicka, Joe, "Generating random correlation matrices based on vines and extended
onion method", 2009, doi:10.1016/j.jmva.2009.04.008.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backsight.errors import TuningError
from backsight.types import Array

NONE = 1e-9
"""Correlation that is none."""


@dataclasses.dataclass(frozen=True)
class FreeMatrix:
    """A covariance in blocks, within which everything is free and between which nothing is.

    Parameters
    ----------
    word : str
        ``R``, ``Q`` or ``Qc``.
    names : tuple of str
        Of its signals.
    blocks : tuple of tuple of int
        Places of the signals of every block; signals in none have no variance.
    """

    word: str
    names: tuple[str, ...]
    blocks: tuple[tuple[int, ...], ...]

    @property
    def entries(self) -> list[tuple[int, int]]:
        """Rows and columns, at or below the diagonal within their block, that are not zero."""
        return [
            (block[i], block[j])
            for block in self.blocks
            for i in range(len(block))
            for j in range(i + 1)
        ]

    def name(self, i: int, j: int) -> str:
        """Name of a variance, ``Q.v``, or of a correlation, ``Q.v.q``."""
        own = f"{self.word}.{self.names[i]}"
        return own if i == j else f"{own}.{self.names[j]}"

    def numbers(self, matrix: Array) -> dict[str, float]:
        """Variances and partial correlations of a covariance, by name.

        Raises
        ------
        TuningError
            If the matrix has a variance or a correlation outside of the blocks, or is singular
            within one.
        """
        found: dict[str, float] = {}
        rest = np.array(matrix, float)
        for block in self.blocks:
            places = np.ix_(block, block)
            part, rest[places] = matrix[places], 0.0
            size = np.sqrt(np.diag(part))
            try:
                L = np.linalg.cholesky(part / np.outer(size, size))
            except np.linalg.LinAlgError:
                raise TuningError(
                    f"'{self.word}' starts singular, so that its entries cannot move freely: free "
                    "it as a whole, or start with a little more on the diagonal"
                ) from None
            for i, a in enumerate(block):
                found[self.name(a, a)] = float(part[i, i])
                for j in range(i):
                    left = 1 - float(L[i, :j] @ L[i, :j])
                    found[self.name(a, block[j])] = float(L[i, j]) / float(np.sqrt(left))
        scale = float(np.abs(matrix).max(initial=0.0))
        if np.abs(rest).max(initial=0.0) > NONE * scale:
            raise TuningError(
                f"'{self.word}' has correlations that its structure leaves out: start without them"
            )
        return found

    def root(self, values: Mapping[str, float]) -> Array:
        """Factor L of the covariance L L'; lower triangular within the blocks, (n, n)."""
        n = len(self.names)
        found = np.zeros((n, n))
        for block in self.blocks:
            size = len(block)
            L = np.zeros((size, size))
            for i, a in enumerate(block):
                left = 1.0
                for j in range(i):
                    L[i, j] = values[self.name(a, block[j])] * np.sqrt(left)
                    left = max(left - float(L[i, j]) ** 2, 0.0)
                L[i, i] = np.sqrt(left)
                L[i] *= np.sqrt(values[self.name(a, a)])
            found[np.ix_(block, block)] = L
        return found

    def matrix(self, values: Mapping[str, float]) -> Array:
        """The covariance, (n, n)."""
        L = self.root(values)
        return L @ L.T

    def products(self) -> list[tuple[tuple[int, int], tuple[int, int], Array]]:
        """The covariance as a sum of products of entries of its root with constant matrices.

        ``(first, second, matrix)`` for :math:`L_{first} L_{second}`.
        """
        n, found = len(self.names), []
        for block in self.blocks:
            for k, column in enumerate(block):
                for i, a in enumerate(block[k:]):
                    for b in block[k : k + i + 1]:
                        E = np.zeros((n, n))
                        E[a, b] = E[b, a] = 1.0
                        found.append(((a, column), (b, column), E))
        return found


def matrices_of(unknowns: Sequence[Any]) -> list[FreeMatrix]:
    """All matrices that unknowns are entries of, each once."""
    return list(dict.fromkeys(u.matrix for u in unknowns if u.matrix is not None))


def blocks_of(
    word: str, names: Sequence[str], variances: Array, structure: str | tuple[str, ...]
) -> FreeMatrix:
    """Blocks of a structure: ``diagonal``, ``full``, or the block of every signal by name.

    Signals without a variance, and those of a block without a name, are in none.

    Raises
    ------
    TuningError
        If the structure has another length than there are signals, or nothing is left.
    """
    if structure == "diagonal":
        labels = [str(i) for i in range(len(names))]
    elif structure == "full":
        labels = ["all"] * len(names)
    else:
        labels = list(structure)
    if len(labels) != len(names):
        raise TuningError(
            f"the structure of '{word}' has {len(labels)} entries; give the block of every one of "
            f"{', '.join(names)}"
        )
    members = {
        label: tuple(i for i, k in enumerate(labels) if k == label and variances[i] > 0)
        for label in dict.fromkeys(labels)
        if label
    }
    found = FreeMatrix(word, tuple(names), tuple(b for b in members.values() if b))
    if not found.blocks:
        raise TuningError(f"'{word}' cannot be free: the noise has none")
    return found
