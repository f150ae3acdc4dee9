"""Type aliases used in signatures."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""A float64 NumPy array; the shape is in the docstring."""

Mask: TypeAlias = NDArray[np.bool_]
"""A NumPy array of booleans."""

ByName: TypeAlias = Mapping[str, float] | Sequence[float] | Array | float
"""One number per signal: a mapping by name, a sequence in order, or one number for all."""
