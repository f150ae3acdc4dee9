"""Operations on matrices that are too large to unroll.

A product with a matrix of few entries is, like a loop, a function whose *name* says what it is: the
virtual machine runs its body, other back ends recognise the name (`dense_of`) and write a loop over
the entries. All other operations are kernels (`backsight.engine.foreign`), which call BLAS and
LAPACK: code for them takes no longer to compile than code for a number.
"""

import dataclasses
import re

import casadi as ca
import numpy as np

from backsight.engine import foreign

UNROLL = 12
"""Up to this many rows straight-line code is faster."""

VECTOR = 4
"""Loops over a multiple of this many rows have no remainder, and are several times faster."""

FEW = 0.25
"""Share of entries up to which a product runs over the entries only."""

NARROW = 4
"""Products that sum over so few numbers are loops: a call of BLAS takes longer than they do."""


@dataclasses.dataclass(frozen=True)
class Product:
    """What a function of this module stands for: ``C, A, F -> C + A F'``, or C + A F.

    Parameters
    ----------
    rows : int
        Of A and C.
    pattern : casadi.Sparsity
        Of F.
    turned : bool
        Whether F is transposed in the product.
    """

    rows: int
    pattern: ca.Sparsity
    turned: bool


_NAME = re.compile(r"dense_product_(by|by_turned)_(\d+)_\d+_\d+_\d+")


def filled_up(rows: int) -> int:
    """Number of rows with those that are better added, as zeros, to a matrix in many products."""
    return -(-rows // VECTOR) * VECTOR


def add_product(C: ca.MX, A: ca.MX, F: ca.MX, *, turned: bool = True) -> ca.MX:
    """C + A F' for dense C and A (m, n) and F, of which only the entries count; or C + A F."""
    if F.nnz() > FEW * F.numel() and (F.shape[int(turned)] > NARROW or A.shape[0] == 1):
        if ca.MX(C).is_zero():
            return product_of(A, F, turned=(False, turned))
        return plus_product(C, A, F, turned=(False, turned))
    (m, n), p = A.shape, F.shape[1 - int(turned)]
    c, a, f = ca.MX.sym("C", m, p), ca.MX.sym("A", m, n), ca.MX.sym("F", F.sparsity())
    name = f"dense_product_{'by_turned' if turned else 'by'}_{m}_{n}_{p}_{F.nnz()}"
    product = c + a @ (f.T if turned else f)
    return ca.Function(name, [c, a, f], [product])(ca.densify(C), ca.densify(A), F)


def few_entries(matrix: np.ndarray) -> ca.DM:
    """The matrix with its entries only, if these are so few that products take them one by one."""
    few = np.count_nonzero(matrix) <= FEW * matrix.size
    return ca.sparsify(ca.DM(matrix)) if few else ca.DM(matrix)


def dense_of(function: ca.Function) -> Product | None:
    """What product a function stands for, or None if it is an ordinary function."""
    match = _NAME.fullmatch(function.name())
    if match is None:
        return None
    return Product(int(match[2]), function.sparsity_in(2), match[1] == "by_turned")


def applied(F: ca.MX | ca.DM, x: ca.MX, *, turned: bool = False) -> ca.MX:
    """F x of a column x, or F' x if `turned`; of F only the entries count."""
    F = ca.MX(F)
    rows = F.shape[int(turned)]
    return add_product(ca.MX.zeros(1, rows), ca.densify(x).T, F, turned=not turned).T


def all_entries(F: ca.MX) -> ca.MX:
    """A matrix of few entries with all its entries."""
    n = F.shape[0]
    return (
        F
        if F.is_dense()
        else add_product(ca.MX.zeros(*F.shape), ca.MX(ca.DM(np.eye(n))), F, turned=False)
    )


Turned = tuple[bool, bool]
"""Whether the first and the second factor of a product are transposed."""


def product_of(A: ca.MX, B: ca.MX, *, turned: Turned = (False, False)) -> ca.MX:
    """op(A) op(B) of dense matrices."""
    shape = _shape(A, B, turned)
    if 0 in (*shape, *A.shape, *B.shape):
        return ca.MX.zeros(*shape[:2])
    sizes = [*shape, *map(int, turned), 0, 0]
    return foreign.call("matrix_product", sizes, inputs=[A, B], outputs=[shape[:2]])[0]


def plus_product(
    C: ca.MX, A: ca.MX, B: ca.MX, *, turned: Turned = (False, False), minus: bool = False
) -> ca.MX:
    """C + op(A) op(B) of dense matrices; with `minus` the product is subtracted."""
    shape = _shape(A, B, turned)
    if 0 in (*shape, *A.shape, *B.shape):
        return ca.densify(C)
    if turned == (False, True) and shape[2] <= NARROW and shape[0] > 1:
        return add_product(C, A, -B if minus else B)
    sizes = [*shape, *map(int, turned), int(minus), 1]
    return foreign.call("matrix_product", sizes, inputs=[A, B, C], outputs=[shape[:2]])[0]


def _shape(A: ca.MX, B: ca.MX, turned: Turned) -> tuple[int, int, int]:
    """Rows and columns of a product, and over how many numbers it sums."""
    rows, inner = reversed(A.shape) if turned[0] else A.shape
    return rows, B.shape[0] if turned[1] else B.shape[1], inner


def transpose(A: ca.MX) -> ca.MX:
    """A' of a dense matrix."""
    if 1 in A.shape or 0 in A.shape:
        return ca.densify(A.T)
    m, n = A.shape
    return foreign.call("matrix_turn", (m, n, 0), inputs=[A], outputs=[(n, m)])[0]


def symmetrise(A: ca.MX) -> ca.MX:
    """(A + A') / 2 of a dense square matrix; A itself where a kernel made it symmetric."""
    if _symmetric_already(A):
        return A
    n = A.shape[0]
    return foreign.call("matrix_turn", (n, n, 1), inputs=[A], outputs=[(n, n)])[0]


def _symmetric_already(A: ca.MX) -> bool:
    """Whether A is a result of a kernel that is symmetric to the last bit."""
    made = _made_by(A)
    if made is None:
        return False
    match made.kernel.name, made.result:
        case "matrix_turn", 0:
            return made.kernel.sizes[2] == 1
        case ("matrix_congruence", 0) | ("matrix_gain", 3):
            return True
        case _:
            return False


@dataclasses.dataclass(frozen=True)
class _Made:
    """Of which call a value is which result."""

    kernel: foreign.Kernel
    inputs: tuple[ca.MX, ...]
    result: int


def _made_by(value: ca.MX) -> _Made | None:
    """The call of a kernel that a value is a result of, or None of another value."""
    if not value.is_output():
        return None
    call = value.dep(0)
    kernel = foreign.kernel_of(call.which_function())
    inputs = tuple(call.dep(i) for i in range(call.n_dep()))
    return None if kernel is None else _Made(kernel, inputs, value.which_output())


def cholesky_of(A: ca.MX) -> ca.MX:
    """Lower factor of a positive semidefinite matrix."""
    n = A.shape[0]
    return foreign.call("matrix_cholesky", (n,), inputs=[A], outputs=[(n, n)])[0]


def solve_triangular(L: ca.MX, B: ca.MX, *, turned: bool = False) -> ca.MX:
    """Solve L X = B, or L' X = B; rows of X without variance are then zero."""
    n, m = B.shape
    if not m:
        return ca.MX.zeros(n, m)
    sizes = (n, m, int(turned))
    return foreign.call("matrix_solve", sizes, inputs=[L, B], outputs=[(n, m)])[0]


def compressed(A: ca.MX) -> ca.MX:
    """Lower triangular L with L L' = A A' and no negative diagonal."""
    n, m = A.shape
    return foreign.call("matrix_compress", (n, m), inputs=[A], outputs=[(n, n)])[0]


def downdated(L: ca.MX, v: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Factor of L L' - v v', and 1 if that is positive definite, else 0."""
    n = L.shape[0]
    outputs = [(n, n), (1, 1)]
    factor, definite = foreign.call("matrix_downdate", (n,), inputs=[L, v], outputs=outputs)
    return factor, definite


def triangle(A: ca.MX, scale: np.ndarray | None = None) -> ca.MX:
    """Lower triangle of a symmetric matrix, given whole (n, n) or as that, in units of `scale`."""
    made = _made_by(A)
    if made is not None and made.kernel.name == "matrix_triangle":
        # In units of units: one pass over the matrix serves both.
        A, former = made.inputs
        scale = former.to_DM().full().ravel() * (1 if scale is None else scale)
    whole = A.shape[1] > 1
    n = A.shape[0] if whole else int((8 * A.numel() + 1) ** 0.5 - 1) // 2
    units = ca.MX(ca.DM(np.ones(n) if scale is None else scale))
    size = (n * (n + 1) // 2, 1)
    inputs, sizes = [A, units], (n, int(not whole))
    return foreign.call("matrix_triangle", sizes, inputs=inputs, outputs=[size])[0]


def unpacked(triangle_: ca.MX, n: int) -> ca.MX:
    """All entries of a symmetric matrix with n rows, from its lower triangle."""
    places = np.zeros((n, n), int)
    rows, columns = np.triu_indices(n)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return ca.reshape(triangle_[places.ravel().tolist()], n, n)


def scaled_rows(A: ca.MX, by: ca.MX) -> ca.MX:
    """Rows of a dense matrix, each times a number."""
    return product_of(by, ca.MX.ones(1, A.shape[1])) * A


def diagonal(values: ca.MX) -> ca.MX:
    """Dense matrix with these numbers on its diagonal."""
    return scaled_rows(ca.MX(ca.DM(np.eye(values.numel()))), values)


def gain_of(PHt: ca.MX, HPHt: ca.MX, R: ca.MX, mask: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Gain K (nx, ny), innovation covariance S and noise N (ny, ny), see `matrix_gain.c`."""
    nx, ny = PHt.shape
    outputs = [(nx, ny), (ny, ny), (ny, ny)]
    inputs = [PHt, HPHt, R, mask]
    K, S, N = foreign.call("matrix_gain", (nx, ny, 0), inputs=inputs, outputs=outputs)
    return K, S, N


def corrected_of(
    P: ca.MX, PHt: ca.MX, HPHt: ca.MX, R: ca.MX, mask: ca.MX
) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
    """Covariance (nx, nx) after a measurement, symmetric as P, and what `gain_of` gives."""
    nx, ny = PHt.shape
    outputs = [(nx, ny), (ny, ny), (ny, ny), (nx, nx)]
    inputs = [PHt, HPHt, R, mask, P]
    K, S, N, after = foreign.call("matrix_gain", (nx, ny, 1), inputs=inputs, outputs=outputs)
    return after, K, S, N


def congruence_of(A: ca.MX, P: ca.MX, Q: ca.MX) -> ca.MX:
    """A P A' + Q of a dense A and symmetric P and Q (n, n); as symmetric."""
    n = A.shape[0]
    return foreign.call("matrix_congruence", (n,), inputs=[A, P, Q], outputs=[(n, n)])[0]


def near_to(A: ca.MX, B: ca.MX, size: np.ndarray, most: float) -> ca.MX:
    """1 if the norm of (A - B) / (size size'), of symmetric matrices, is at most that, else 0."""
    given = [A, B, ca.MX(ca.DM(size)), ca.MX(most)]
    return foreign.call("matrix_near", (A.shape[0],), inputs=given, outputs=[(1, 1)])[0]
