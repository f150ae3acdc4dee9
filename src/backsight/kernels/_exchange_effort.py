"""What exchanges of atoms in ``cs_window`` cost at most, see `cs_window_candidates.h`."""

import dataclasses

from backsight.kernels._work import KernelWork, dots, products

CHANGES = 8
"""As in `cs_window_problem.h`."""


@dataclasses.dataclass(frozen=True)
class Candidates:
    """Atoms of a window, of which some are chosen.

    Parameters
    ----------
    nx, n, d, length : int
        States, atoms, modal forces of the window, and those of an atom.
    room : int
        Most atoms that may be chosen.
    gradients, quiet : KernelWork
        Products of all atoms with modal forces, and the same of the data.
    """

    nx: int
    n: int
    d: int
    length: int
    room: int
    gradients: KernelWork
    quiet: KernelWork

    def _offer(self) -> KernelWork:
        """Every atom by itself."""
        nx, length = self.nx, self.length
        each = products(nx, length) + products(nx, nx) + products(length, length)
        own = dots(length) + dots(nx) + KernelWork(3 * nx + length + 6)
        return self.quiet + self.n * (each + own)

    def _continue(self, s: int) -> KernelWork:
        """A row of the factor, and of its inverse."""
        inverse = sum((KernelWork(2 * j + 4) for j in range(s)), KernelWork(0))
        return products(self.n, s) + inverse + KernelWork(7 * self.n + 4, 1, 1)

    def _refactor(self, s: int) -> KernelWork:
        return sum((self._continue(i) for i in range(s)), KernelWork(2 * self.n))

    def _take(self, s: int) -> KernelWork:
        column = products(self.d, self.length) + self.gradients + products(self.n, self.nx)
        return KernelWork(self.d) + column + self._continue(s)

    def _settle(self, s: int) -> KernelWork:
        return KernelWork(s + s * (s + 1))

    def _choose(self, s: int) -> KernelWork:
        refused = self._refactor(s) + self._settle(s)
        return self._take(s) + self._settle(s + 1) + KernelWork(2 * s) + refused

    def _shared(self, s: int) -> KernelWork:
        return KernelWork(self.n + 2 * s) + products(self.n, s)

    def _looks(self) -> KernelWork:
        """All atoms, in place of a chosen one."""
        return KernelWork(12 * self.n + 2, self.n + 2)

    def _put_last(self, s: int) -> KernelWork:
        return KernelWork(self.n * (s + 2) + s)

    def _exchanged(self) -> KernelWork:
        """A change may look at all atoms in place of every one that is chosen."""
        s = self.room
        tried = 2 * s * self._put_last(s) + 2 * self._refactor(s) + self._choose(s)
        each = self._shared(s) + self._looks() + tried + self._take(s) + self._settle(s)
        out = KernelWork(s * (2 * s + 3), s) + self._put_last(s) + self._refactor(s)
        first = self._settle(s) + out + self._looks() + self._choose(s)
        return (CHANGES * s + 1) * (first + s * each)

    @property
    def searched(self) -> KernelWork:
        """Two searches, from some atoms and from none."""
        s = self.room
        start = KernelWork(2 * self.n) + s * self._choose(s)
        return self._offer() + 2 * (start + self._exchanged() + dots(s))

    @property
    def doubted(self) -> KernelWork:
        """Which atoms could nearly as well have been chosen."""
        s = self.room
        looks = s * (self._take(s) + self._shared(s) + KernelWork(3, 1) + self._looks())
        return KernelWork(4 * self.n) + looks + self._settle(s)
