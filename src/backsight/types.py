"""Type aliases used in signatures."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""A float64 NumPy array; the shape is in the docstring."""

Indices: TypeAlias = NDArray[Any]
"""Whole numbers or truth values that choose entries of arrays."""

Complex: TypeAlias = NDArray[np.complex128]
"""An array of complex numbers."""

Sparse: TypeAlias = Any
"""A sparse array of SciPy in columns, `csc_array`; SciPy says no types of its own."""

Mask: TypeAlias = NDArray[np.bool_]
"""A NumPy array of booleans."""

ByName: TypeAlias = Mapping[str, float] | Sequence[float] | Array | float
"""One number per signal: a mapping by name, a sequence in order, or one number for all."""
