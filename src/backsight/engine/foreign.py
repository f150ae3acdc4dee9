"""Kernels in C99 as functions of CasADi.

Like a loop, a call of a kernel is a function whose *name* says which kernel with which sizes: the
virtual machine calls the compiled kernel, other back ends recognise the name (`kernel_of`) and
write a call of their own.
"""

import ctypes
import dataclasses
import re
import threading
from collections.abc import Sequence

import casadi as ca

from backsight.errors import EngineError
from backsight.kernels import library


@dataclasses.dataclass(frozen=True)
class Kernel:
    """A kernel for certain sizes.

    Parameters
    ----------
    name : str
    sizes : tuple of int
    """

    name: str
    sizes: tuple[int, ...]


_NAME = re.compile(r"foreign((?:_\d+)*)_of_(\w+)")

_DECLARING = threading.Lock()


def call(
    kernel: str,
    sizes: Sequence[int],
    *,
    inputs: Sequence[ca.MX],
    outputs: Sequence[tuple[int, int]],
) -> list[ca.MX]:
    """Call a kernel of `backsight.kernels`.

    Parameters
    ----------
    kernel : str
    sizes : sequence of int
        What the kernel is told about its problem.
    inputs : sequence of MX
        Its arguments; they are made dense.
    outputs : sequence of (int, int)
        Shapes of its results.

    Raises
    ------
    EngineError
        If there is no such kernel, it is not compiled, or a size is wrong.
    """
    dense = [_dense(value) for value in inputs]
    shapes = [value.shape for value in dense]
    empty = not shapes or not outputs or any(0 in shape for shape in (*shapes, *outputs))
    if empty or any(size < 0 for size in sizes):
        raise EngineError(
            f"the kernel '{kernel}' is called with sizes {tuple(sizes)}, arguments {shapes} and "
            f"results {list(outputs)}: no size may be negative, and nothing may be empty"
        )
    name = "_".join(["foreign", *map(str, sizes), "of", kernel])
    symbols = [ca.MX.sym(f"i{k}", *shape) for k, shape in enumerate(shapes)]
    external = _external(kernel, sizes, inputs=[(len(sizes) + 1, 1), *shapes], outputs=outputs)
    # In this function the kernel gets an address for every argument and result, never a null.
    results = external.call([ca.MX(ca.DM([len(sizes), *sizes])), *symbols])
    return ca.Function(name, symbols, results).call(dense)


def _dense(value: ca.MX) -> ca.MX:
    """The value with all its entries; of constants no operation is left that would fill them in."""
    value = ca.MX(value)
    if value.is_constant() and not value.is_dense():
        return ca.MX(ca.densify(value.to_DM()))
    return ca.densify(value)


def kernel_of(function: ca.Function) -> Kernel | None:
    """Which kernel a function stands for, or None if it is an ordinary function."""
    match = _NAME.fullmatch(function.name())
    if match is None:
        return None
    return Kernel(match.group(2), tuple(map(int, match.group(1).split("_")[1:])))


def _external(
    kernel: str,
    sizes: Sequence[int],
    *,
    inputs: Sequence[tuple[int, int]],
    outputs: Sequence[tuple[int, int]],
) -> ca.Function:
    """Return the kernel as a function whose first argument tells its sizes, see bridge.c."""
    reals, ints = library.work(kernel, sizes)
    shapes = [number for rows, columns in (*inputs, *outputs) for number in (rows, columns, 1)]
    whole = ctypes.c_longlong
    table = (whole * len(shapes))(*shapes)  # must live until the function is made
    counts = map(whole, [len(inputs), len(outputs), reals, ints + len(sizes)])
    declare, file = library.handle().foreign_declare, library.path()
    with _DECLARING:
        declare(*counts, table)
        # The name of the file alone: a pickled recursion must not hold a path of this computer.
        external = ca.external(f"foreign_{kernel}", file.name)
        declare(*[whole(0)] * 4, None)
    if external.n_in() != len(inputs):
        raise EngineError(
            f"CasADi takes the C kernels from another file than '{file}': look for '{file.name}' "
            "in the folders of LD_LIBRARY_PATH and CASADIPATH and remove it"
        )
    return external
