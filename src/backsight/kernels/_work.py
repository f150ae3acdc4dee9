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
