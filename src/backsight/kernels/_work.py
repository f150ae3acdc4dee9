"""Operations of a kernel, counted."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class KernelWork:
    """Numbers of operations.

    Parameters
    ----------
    plain : int
        Additions, multiplications, comparisons.
    divisions, roots : int
    """

    plain: int
    divisions: int = 0
    roots: int = 0

    def __add__(self, other: KernelWork) -> KernelWork:
        return KernelWork(
            self.plain + other.plain, self.divisions + other.divisions, self.roots + other.roots
        )

    def __rmul__(self, times: int) -> KernelWork:
        return KernelWork(times * self.plain, times * self.divisions, times * self.roots)

    def or_(self, other: KernelWork) -> KernelWork:
        """At least as much as either."""
        return KernelWork(
            max(self.plain, other.plain),
            max(self.divisions, other.divisions),
            max(self.roots, other.roots),
        )


def products(rows: int, n: int) -> KernelWork:
    return KernelWork(n * (2 * rows + 1))


def dots(n: int) -> KernelWork:
    return KernelWork(2 * n + 1)


def factoring(n: int) -> KernelWork:
    return KernelWork(sum(2 + j + 2 * (n - j) * j + n - j for j in range(n)), n, n)


def readying(n: int) -> KernelWork:
    return KernelWork(n, n)


def forward_solve(n: int) -> KernelWork:
    return KernelWork(n * n + n + 1)


def backward_solve(first: int, n: int) -> KernelWork:
    return KernelWork(n * n - first * first + n + first + 2)


def posterior_work(n: int) -> KernelWork:
    """`cs_window_posterior`."""
    right = sum((products(n, n - j) for j in range(n)), KernelWork(0))
    both = sum(((i + 1) * (dots(n - i) + KernelWork(1)) for i in range(n)), KernelWork(0))
    return 2 * factoring(n) + right + both + readying(n) + n * forward_solve(n)


def unknown_work(n: int) -> KernelWork:
    """`cs_window_unknown`."""
    return factoring(n) + KernelWork(3 * n) + readying(n) + n * forward_solve(n)
