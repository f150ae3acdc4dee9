"""Operations of an MX function between its calls, as small SX functions."""

import functools
from collections.abc import Callable

import casadi as ca

from backsight.engine.program.leaf import operation_name
from backsight.errors import EngineError

ELEMENTWISE = {*range(ca.OP_ASSIGN, ca.OP_CONST), ca.OP_ATAN2, ca.OP_LOG1P, ca.OP_EXPM1}
ELEMENTWISE |= {ca.OP_HYPOT, ca.OP_REMAINDER, ca.OP_ERFINV}
"""Operations that work on entry after entry."""

Rule = Callable[[ca.MX, list[ca.SX]], list[ca.SX]]


def glue(node: ca.MX, operation: int, name: str) -> ca.Function:
    """Return one node of an MX function as an SX function of its operands.

    Parameters
    ----------
    node : MX
    operation : int
        CasADi's code.
    name : str
        Of the function it stands in, for messages.

    Raises
    ------
    EngineError
        If there is no rule for the operation.
    """
    symbols = [ca.SX.sym("x", node.dep(i).sparsity()) for i in range(node.n_dep())]
    rule = RULES.get(operation)
    if operation in ELEMENTWISE:
        results = [_elementwise(operation, symbols)]
    elif rule is not None:
        results = rule(node, symbols)
    else:
        raise EngineError(
            f"'{name}' uses the operation {operation_name(operation)} outside of a leaf, which "
            "cannot be compiled; use engine='vm' or put it into an SX function"
        )
    return ca.Function(operation_name(operation).lower(), symbols, results)


@functools.cache
def scalar(operation: int, n: int) -> ca.Function:
    """Return an elementwise operation as a function of n numbers."""
    symbols = [ca.SX.sym("x") for _ in range(n)]
    return ca.Function(
        operation_name(operation).lower(), symbols, [_elementwise(operation, symbols)]
    )


def _elementwise(operation: int, operands: list[ca.SX]) -> ca.SX:
    if len(operands) == 1:
        return ca.SX.unary(operation, operands[0])
    return ca.SX.binary(operation, *operands)


def _constant(node: ca.MX, _: list[ca.SX]) -> list[ca.SX]:
    return [ca.SX(node.to_DM())]


def _concatenate(node: ca.MX, parts: list[ca.SX]) -> list[ca.SX]:
    # CasADi only concatenates so that the entries of the parts follow each other in memory.
    return [_filled(node.sparsity(), ca.vertcat(*(_entries(part) for part in parts)))]


def _split(node: ca.MX, parts: list[ca.SX]) -> list[ca.SX]:
    pieces = [node.get_output(i) for i in range(node.n_out())]
    entries, ends = _entries(parts[0]), node.info()["offset"]
    return [
        _filled(p.sparsity(), entries[a:b])
        for p, a, b in zip(pieces, ends[:-1], ends[1:], strict=True)
    ]


def _get(node: ca.MX, parts: list[ca.SX]) -> list[ca.SX]:
    return [_filled(node.sparsity(), ca.vec(parts[0].nz[positions(node)]))]


def _set(node: ca.MX, parts: list[ca.SX]) -> list[ca.SX]:
    result, at = ca.SX(parts[0]), positions(node)
    result.nz[at] = _entries(parts[1]) + (ca.vec(result.nz[at]) if node.info()["add"] else 0)
    return [result]


def positions(node: ca.MX) -> list[int]:
    """Places of the entries that a node takes or sets."""
    info = node.info()
    if "nz" in info:
        return list(info["nz"])
    if "slice" in info:
        return list(_range(info["slice"]))
    return [outer + inner for outer in _range(info["outer"]) for inner in _range(info["inner"])]


def _range(part: dict[str, int]) -> range:
    return range(part["start"], part["stop"], part["step"])


def _multiply(node: ca.MX, parts: list[ca.SX]) -> list[ca.SX]:
    product = ca.project(parts[1] @ parts[2], node.sparsity())
    return [ca.project(parts[0], node.sparsity()) + product]


def _filled(sparsity: ca.Sparsity, entries: ca.SX) -> ca.SX:
    return ca.SX(sparsity, entries) if entries.numel() else ca.SX(sparsity)


def _entries(x: ca.SX) -> ca.SX:
    """The entries that are there, in the order in memory, as a column."""
    return ca.vec(x.nz[:])


RULES: dict[int, Rule] = {
    ca.OP_CONST: _constant,
    ca.OP_VERTCAT: _concatenate,
    ca.OP_HORZCAT: _concatenate,
    ca.OP_DIAGCAT: _concatenate,
    ca.OP_VERTSPLIT: _split,
    ca.OP_HORZSPLIT: _split,
    ca.OP_DIAGSPLIT: _split,
    ca.OP_RESHAPE: lambda node, x: [_filled(node.sparsity(), _entries(x[0]))],
    ca.OP_SPARSITY_CAST: lambda node, x: [_filled(node.sparsity(), _entries(x[0]))],
    ca.OP_GETNONZEROS: _get,
    ca.OP_SETNONZEROS: _set,
    ca.OP_ADDNONZEROS: _set,
    ca.OP_PROJECT: lambda node, x: [ca.project(x[0], node.sparsity())],
    ca.OP_TRANSPOSE: lambda _, x: [x[0].T],
    ca.OP_HORZREPMAT: lambda node, x: [ca.repmat(x[0], 1, node.shape[1] // x[0].shape[1])],
    ca.OP_HORZREPSUM: lambda node, x: [ca.repsum(x[0], 1, x[0].shape[1] // node.shape[1])],
    ca.OP_MTIMES: _multiply,
    ca.OP_DOT: lambda _, x: [ca.dot(x[0], x[1])],
    ca.OP_BILIN: lambda _, x: [ca.bilin(*x)],
    ca.OP_RANK1: lambda _, x: [ca.rank1(*x)],
    ca.OP_KRON: lambda _, x: [ca.kron(x[0], x[1])],
    ca.OP_NORM1: lambda _, x: [ca.norm_1(x[0])],
    ca.OP_NORM2: lambda _, x: [ca.norm_2(x[0])],
    ca.OP_NORMF: lambda _, x: [ca.norm_fro(x[0])],
    ca.OP_NORMINF: lambda _, x: [ca.norm_inf(x[0])],
    ca.OP_MMIN: lambda _, x: [ca.mmin(x[0])],
    ca.OP_MMAX: lambda _, x: [ca.mmax(x[0])],
    ca.OP_DETERMINANT: lambda _, x: [ca.det(x[0])],
}
"""How the operations that are not elementwise are written; sparse entries stay in their order."""
