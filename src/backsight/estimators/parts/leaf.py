"""Formulas as functions: the names of their arguments say how large they are.

The names are those of docs/notation.md, with or without an ending: ``x``, ``x_next`` and ``x_last``
are states. Covariances (``P``, ``Q``, ``S``, ``R``) are symmetric: a function takes and returns
their lower triangle (or, of many states, all of ``P``, see `covariance`), the formula has the
matrix.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.dense import UNROLL, triangle
from backsight.errors import EngineError
from backsight.estimators.parts.covariance import Covariance, Term
from backsight.estimators.parts.flags import FLAGS
from backsight.estimators.scaled import Setting


@dataclasses.dataclass(frozen=True)
class Symmetric:
    """Size of a symmetric (n, n) matrix that travels as its lower triangle."""

    n: int


Size = int | tuple[int, int] | Symmetric
"""Length of a column, shape of a matrix, or size of a symmetric one."""

Sizes = Mapping[str, Size]
"""Size by name."""

Results = Mapping[str, Term]
"""What a formula gives, by name."""

Formula = Callable[..., Results]
"""Arguments by name to results."""


def notation(s: Setting) -> dict[str, Size]:
    """Sizes of the names of docs/notation.md for a model."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    return {
        "x": nx, "u": nu, "ua": nu, "ub": nu, "y": ny, "mask": ny, "e": ny, "flags": FLAGS,
        "P": Symmetric(nx), "Q": Symmetric(nx), "S": Symmetric(ny), "R": Symmetric(ny),
        "K": (nx, ny), "H": (ny, nx), "F": (nx, nx), "Phi": (nx, nx),
    }  # fmt: skip


def leaf(name: str, sizes: Sizes, formula: Formula) -> ca.Function:
    """Straight-line function of a formula.

    Parameters
    ----------
    name : str
    sizes : dict
        Usually `notation`, with the sizes of other names beside it.
    formula : callable
        Takes SX expressions by the names of its arguments, returns a dict of results.

    Raises
    ------
    EngineError
        If an argument has no size, or a result another one than its name says.
    """
    arguments = {k: _size(k, sizes, name) for k in inspect.signature(formula).parameters}
    symbols = {k: _symbol(k, size) for k, size in arguments.items()}
    opened = [unvech(v) if isinstance(arguments[k], Symmetric) else v for k, v in symbols.items()]
    results = {k: _closed(k, v, sizes, name) for k, v in formula(*opened).items()}
    return ca.Function(
        name,
        list(symbols.values()),
        list(results.values()),
        list(symbols),
        _apart(symbols, results),
    )


def half(name: str, s: Setting, formula: Formula, sizes: Sizes | None = None) -> ca.Function:
    """Half of a filter: a `leaf` of a formula with covariances, with loops if the model is large.

    The formula is written once. Of a model with many states it gets MX expressions and all of P;
    products with P are then those of `backsight.estimators.parts.covariance`, and what is left
    must be leaves.
    """
    known = {**notation(s), **(sizes or {})}
    covariance = Covariance(s.model.nx)
    if not covariance.whole:
        return leaf(name, known, formula)
    arguments = {k: _size(k, known, name) for k in inspect.signature(formula).parameters}
    symbols, opened = {}, []
    for k, size in arguments.items():
        if isinstance(size, Symmetric):
            symbols[k] = ca.MX.sym(k, covariance.size)
            opened.append(covariance.opened(symbols[k]))
        else:
            symbols[k] = ca.MX.sym(k, *_shape(size))
            opened.append(symbols[k])
    results = {}
    for k, value in formula(*opened).items():
        size = known.get(_base(k, known))
        if isinstance(size, Symmetric):
            small = size.n != covariance.n or _base(k, known) in OF_OUTPUTS
            results[k] = _triangle(size.n)(value) if small else covariance.closed(value)
        else:
            results[k] = ca.densify(value)
    return ca.Function(
        name,
        list(symbols.values()),
        list(results.values()),
        list(symbols),
        _apart(symbols, results),
    )


def named_results(function: ca.Function, *arguments: Term) -> dict[str, Term]:
    """Results of a function of `leaf` or `half` by the names that its formula gives them."""
    results = function.call(list(arguments))
    names = (function.name_out(i).removesuffix(ENDING) for i in range(function.n_out()))
    return dict(zip(names, results, strict=True))


OF_OUTPUTS = ("S", "R")
"""Covariances that are triangles however many outputs there are."""

ENDING = "_out"
"""Of a result with the name of an argument; CasADi wants them to differ."""


def _base(name: str, sizes: Sizes) -> str:
    """The name itself if it has a size, else what stands before its ending."""
    return name if name in sizes else name.split("_")[0]


def _size(argument: str, sizes: Sizes, name: str) -> Size:
    base = _base(argument, sizes)
    if base not in sizes:
        raise EngineError(
            f"'{name}' has an argument '{argument}' without a size; take a name of {list(sizes)}, "
            "or give its size"
        )
    return sizes[base]


def _symbol(name: str, size: Size) -> ca.SX:
    if isinstance(size, Symmetric):
        return ca.SX.sym(name, size.n * (size.n + 1) // 2)
    return ca.SX.sym(name, *_shape(size))


def _shape(size: int | tuple[int, int]) -> tuple[int, int]:
    return (size, 1) if isinstance(size, int) else size


def _closed(result: str, value: Term, sizes: Sizes, name: str) -> ca.SX:
    value, size = ca.SX(value), sizes.get(_base(result, sizes))
    if size is None:
        return value
    wanted = (size.n, size.n) if isinstance(size, Symmetric) else _shape(size)
    if value.shape != wanted:
        raise EngineError(
            f"'{name}' gives '{result}' the shape {value.shape}; its name says {wanted}"
        )
    if isinstance(size, Symmetric):
        return vech(value)
    return ca.densify(value) if isinstance(size, int) else value


def _triangle(n: int) -> ca.Function:
    if n > UNROLL:
        whole = ca.MX.sym("S", n, n)
        return ca.Function("lower_triangle", [whole], [triangle(whole)])
    S = ca.SX.sym("S", n, n)
    return ca.Function("lower_triangle", [S], [vech(S)])


def _apart(symbols: Mapping[str, Term], results: Mapping[str, Term]) -> list[str]:
    """Names of results, other than those of arguments."""
    return [f"{k}{ENDING}" if k in symbols else k for k in results]
