"""The compiled kernels."""

import contextlib
import ctypes
import functools
import importlib
import importlib.machinery
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from backsight.errors import EngineError, nearest
from backsight.kernels import sources

NAME = "_backsight"
"""Of the library's file, without the ending."""

REMEDY = (
    "install a C compiler and Backsight again ('pip install .' in its folder), or one of its wheels"
)


def path() -> Path:
    """Return the file of the library.

    Raises
    ------
    EngineError
        If the kernels have not been compiled.
    """
    endings = importlib.machinery.EXTENSION_SUFFIXES
    found = [f for ending in endings if (f := sources.FOLDER / f"{NAME}{ending}").is_file()]
    if not found:
        raise EngineError(f"the C kernels of Backsight are not compiled: {REMEDY}")
    return found[0]


def missing() -> str:
    """What to tell of an installation without the kernels; nothing if they are there."""
    try:
        path()
    except EngineError as error:
        return str(error)
    return ""


def address(kernel: str) -> int:
    """Return the address of a kernel in this process.

    Raises
    ------
    EngineError
        If there is no such kernel, or the kernels have not been compiled from these sources.
    """
    return ctypes.cast(_with(kernel)[kernel], ctypes.c_void_p).value or 0


def work(kernel: str, sizes: Sequence[int]) -> tuple[int, int]:
    """Return how many numbers and how many ints of work space a call needs.

    Raises
    ------
    EngineError
        As `address`.
    """
    reals, ints = ctypes.c_long(), ctypes.c_long()
    given = (ctypes.c_int * max(len(sizes), 1))(*sizes)
    _with(kernel)[f"{kernel}_work"](given, ctypes.byref(reals), ctypes.byref(ints))
    return reals.value, ints.value


Sizes = tuple[int, ...]
Arguments = Sequence[npt.NDArray[np.float64]]
OnArrays = Callable[[Sizes, Arguments, Sequence[Sizes]], Arguments]


def on_arrays(kernel: str) -> OnArrays:
    """Return a kernel as a function of arrays: ``(sizes, arguments, shapes) -> results``.

    Arguments and results are columns one after the other; of rows in C's order give the transpose.

    Raises
    ------
    EngineError
        As `address`.
    """
    address(kernel)
    library = handle()
    run, need = library[kernel], library[f"{kernel}_work"]
    run.argtypes = [ctypes.POINTER(ctypes.c_int), *[_ANY] * 4]

    def call(sizes: Sizes, arguments: Arguments, shapes: Sequence[Sizes]) -> Arguments:
        given = (ctypes.c_int * len(sizes))(*sizes)
        reals, ints = ctypes.c_long(), ctypes.c_long()
        need(given, ctypes.byref(reals), ctypes.byref(ints))
        work = np.empty(reals.value), np.empty(ints.value, np.int32)
        columns = [np.asfortranarray(a, float) for a in arguments]
        results = [np.empty(shape, order="F") for shape in shapes]
        run(given, _places(columns), _places(results), *map(_place, work))
        return results

    return call


_ANY = ctypes.c_void_p


def _places(arrays: Arguments) -> ctypes.Array[ctypes.c_void_p]:
    """Addresses of arrays."""
    return (_ANY * len(arrays))(*map(_place, arrays))


def _place(array: npt.NDArray[Any]) -> int:
    # Not `array.ctypes.data`, which takes several times as long.
    place: int = array.__array_interface__["data"][0]
    return place


def handle() -> ctypes.CDLL:
    """Return the library in this process.

    Raises
    ------
    EngineError
        If the kernels have not been compiled from these sources.
    """
    return _loaded(path(), _known(sources.state())[0])


@functools.lru_cache(maxsize=4)
def _known(state: sources.State) -> tuple[str, tuple[str, ...]]:  # noqa: ARG001 - that of files
    """Fingerprint of the sources, and names of the kernels: read anew when a file changes."""
    return sources.fingerprint(), tuple(sources.names())


def _with(kernel: str) -> ctypes.CDLL:
    """The library, if it has that kernel."""
    path()
    known = _known(sources.state())[1]
    if kernel not in known:
        raise EngineError(f"there is no kernel '{kernel}': {nearest(kernel, known)}")
    return handle()


@functools.cache
def _loaded(file: Path, expected: str) -> ctypes.CDLL:
    library = ctypes.CDLL(str(file))
    _provide_blas(library)
    made_of = library.foreign_sources
    made_of.restype = ctypes.c_char_p
    if made_of().decode() != expected:
        raise EngineError(f"the C kernels of Backsight were compiled from other sources: {REMEDY}")
    return library


BLAS = {
    "gemm": "blas", "gemv": "blas", "trsm": "blas", "trmm": "blas", "syrk": "blas",
    "potrf": "lapack", "geqrf": "lapack",
}  # fmt: skip
"""Functions in the order of blas.h, and which of SciPy's modules has them."""


def _provide_blas(library: ctypes.CDLL) -> None:
    """Tell the kernels where SciPy's BLAS and LAPACK are; they have loops of their own, too."""
    if not hasattr(library, "foreign_blas"):
        return
    table = (ctypes.c_void_p * len(BLAS))(*(_capsule(f"d{n}", m) for n, m in BLAS.items()))
    library.foreign_blas(table)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let SciPy's BLAS work in the calling thread: matrices of a filter are too small for several.

    Threads that wait for each other make a sample many times slower where cores are shared. Of
    another BLAS than OpenBLAS, and before a kernel was loaded, nothing changes.
    """
    if not _loaded.cache_info().currsize or (calls := _thread_calls()) is None:
        yield
        return
    get, limit = calls
    before = get()
    limit(1)
    try:
        yield
    finally:
        limit(before)


@functools.cache
def _thread_calls() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """How OpenBLAS tells and takes the number of its threads, None of another library."""
    blas = ctypes.CDLL(importlib.import_module("scipy.linalg.cython_blas").__file__)
    for prefix in ("scipy_openblas", "openblas"):
        if hasattr(blas, f"{prefix}_set_num_threads"):
            return blas[f"{prefix}_get_num_threads"], blas[f"{prefix}_set_num_threads"]
    return None


def _capsule(function: str, module: str) -> int | None:
    """Address of a function of double numbers and plain ints, or None if SciPy has another kind."""
    interface = importlib.import_module(f"scipy.linalg.cython_{module}").__pyx_capi__[function]
    get_name = ctypes.pythonapi.PyCapsule_GetName
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_name.restype, get_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    get_pointer.restype = ctypes.c_void_p
    get_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    signature: bytes = get_name(interface)
    return get_pointer(interface, signature) if b", int *" in signature else None
