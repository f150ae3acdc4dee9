"""Largest number of operations of a kernel, by its sizes; what the loops of its source count.

A multiplication, addition, comparison, sign or absolute value is plain. Tests count what the source
does and compare, so that this file follows the source.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from backsight.kernels._stages_effort import motion_effort, stages_effort
from backsight.kernels._window_effort import window_effort
from backsight.kernels._work import KernelWork


def kernel_effort(name: str, sizes: Sequence[int]) -> KernelWork | None:
    """Largest number of operations of one call; None of a kernel that is not from here."""
    return KERNELS[name](*sizes) if name in KERNELS else None


def _factor(n: int) -> KernelWork:
    inner = sum(2 * j * (n - j) + 2 + (n - j) for j in range(n))
    return KernelWork(inner, n, n)


def _divide(n: int, m: int) -> KernelWork:
    return KernelWork(m * n * (n - 1), m * n)


def _cholesky(n: int) -> KernelWork:
    return _factor(n)


def _product(m: int, n: int, k: int, *_: int) -> KernelWork:
    return KernelWork(2 * m * n * k + max(n * k, 2 * m * n))


def _solve(n: int, m: int, transposed: int) -> KernelWork:
    found = _divide(n, m)
    if transposed:  # and whether a direction has no variance, for each pass of the solution
        found += KernelWork(n * (n + 1) + 3 * n + n * m, 0, n)
    return found


def _compress(n: int, m: int) -> KernelWork:
    size = n * (2 * m + m)
    return KernelWork(size + 2 * m * n * (n - 1), n * m, n)


def _downdate(n: int) -> KernelWork:
    apart = n * (n - 1) // 2
    return KernelWork(5 * n + 5 * apart, 2 * n + apart, n)


def _gain(nx: int, ny: int, corrected: int) -> KernelWork:
    of_pairs = KernelWork(12 * ny * ny, 2 * ny * ny)
    after = KernelWork(corrected * nx * (nx + 1) * (ny + 1))
    return of_pairs + _factor(ny) + KernelWork(2 * nx * ny) + 2 * _divide(ny, nx) + after


def _congruence(n: int) -> KernelWork:
    return KernelWork(2 * n**3 + n * n + n * n * (n + 1))


def _near(n: int) -> KernelWork:
    return KernelWork(4 * n * n + 5 * n + 2, n)


def _triangle(n: int, _: int) -> KernelWork:
    return KernelWork(n * (n + 1))


def _turn(m: int, n: int, symmetric: int) -> KernelWork:
    return KernelWork(m * n, m * n) if symmetric else KernelWork(0)


def _innovations(nx: int, ny: int, n: int) -> KernelWork:
    """Of a recording in which no sample is like the one before."""
    pairs = ny * (ny + 1) // 2
    spread = KernelWork(2 * nx * ny * (nx + ny) + 8 * pairs + 2 * nx * ny, pairs)
    spread += _factor(ny) + KernelWork(0, ny * ny)
    gain = KernelWork(2 * nx * ny * ny + 2 * nx * nx * ny + nx * ny, nx * ny)
    ahead = KernelWork(4 * nx**3 + 6 * nx * nx * ny + 2 * nx * ny * ny + 7 * nx * nx)
    sample = KernelWork(4 * nx * ny + 2 * nx * nx + ny * ny + 4 * ny + 2)
    return n * (spread + gain + ahead + sample)


KERNELS: dict[str, Callable[..., KernelWork]] = {
    "cs_window": window_effort,
    "cs_window_motion": motion_effort,
    "cs_window_stages": stages_effort,
    "matrix_cholesky": _cholesky,
    "matrix_compress": _compress,
    "matrix_congruence": _congruence,
    "matrix_downdate": _downdate,
    "matrix_gain": _gain,
    "matrix_innovations": _innovations,
    "matrix_near": _near,
    "matrix_product": _product,
    "matrix_solve": _solve,
    "matrix_triangle": _triangle,
    "matrix_turn": _turn,
}
"""Every kernel."""
