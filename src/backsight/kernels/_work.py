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


def of_product(rows: int, n: int) -> KernelWork:
    return KernelWork(n * (2 * rows + 1))


def of_dot(n: int) -> KernelWork:
    return KernelWork(2 * n + 1)


def of_factor(n: int) -> KernelWork:
    return KernelWork(sum(2 + j + 2 * (n - j) * j + n - j for j in range(n)), n, n)


def of_ready(n: int) -> KernelWork:
    return KernelWork(n, n)


def of_forward(n: int) -> KernelWork:
    return KernelWork(n * n + n + 1)


def of_backward(first: int, n: int) -> KernelWork:
    return KernelWork(n * n - first * first + n + first + 2)


def of_posterior(n: int) -> KernelWork:
    """`cs_window_posterior`."""
    right = sum((of_product(n, n - j) for j in range(n)), KernelWork(0))
    both = sum(((i + 1) * (of_dot(n - i) + KernelWork(1)) for i in range(n)), KernelWork(0))
    return 2 * of_factor(n) + right + both + of_ready(n) + n * of_forward(n)


def of_unknown(n: int) -> KernelWork:
    """`cs_window_unknown`."""
    return of_factor(n) + KernelWork(3 * n) + of_ready(n) + n * of_forward(n)
