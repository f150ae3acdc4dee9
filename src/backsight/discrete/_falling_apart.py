"""Large models that fall apart, such as modes: each part by itself."""

from collections.abc import Iterator

import numpy as np
import scipy

from backsight.types import Array

LARGE = 32
"""With fewer states all together takes no longer than part by part."""


def independent_parts(*matrices: Array) -> Iterator[list[int]]:
    """States that move together, by the entries of matrices (n, n) that are not zero."""
    n = len(matrices[0])
    if n < LARGE:
        yield list(range(n))
        return
    joined = np.logical_or.reduce([m != 0 for m in matrices])
    count, of = scipy.sparse.csgraph.connected_components(joined, directed=False)
    for part in range(count):
        yield np.flatnonzero(of == part).tolist()
