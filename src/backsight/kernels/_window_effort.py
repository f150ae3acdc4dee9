"""What a window of ``cs_window`` costs at most: its functions, in their order, under their names.

Everything that may be active is: as many atoms as there is room for.
"""

import dataclasses
from functools import cached_property

from backsight.kernels._exchange_effort import Candidates
from backsight.kernels._work import (
    KernelWork,
    backward_solve,
    dots,
    factoring,
    forward_solve,
    posterior_work,
    products,
    readying,
    unknown_work,
)

NONE, FILTERED = 0, 2
"""Arrival costs as `cs_window_tables.h` counts them."""

PLACES = 3


def window_effort(*sizes: int) -> KernelWork:
    """Largest number of operations of one window."""
    return Window(*sizes).whole


@dataclasses.dataclass(frozen=True)
class Window:
    """A problem by the sizes that the kernel is told."""

    nx: int
    ny: int
    p: int
    width: int
    atoms: int
    steps: int
    N: int
    forces: int
    most: int
    limit: int
    arrival: int
    correction: int
    carries: int
    limits: int
    bounded: int
    varying: int
    sided: int
    passes: int
    chosen: int

    @property
    def m(self) -> int:
        """Rows of all measurements and limited sums."""
        return self.ny * (self.N + 1)

    @property
    def d(self) -> int:
        """Modal forces of the window."""
        return self.p * self.steps

    @property
    def n(self) -> int:
        """Atoms of the window."""
        return self.atoms * self.steps

    @property
    def columns(self) -> int:
        """Atoms and their extra states."""
        return self.n * (1 + self.carries)

    @property
    def rows(self) -> int:
        """Rows of the tables."""
        return self.nx + self.d + PLACES * self.nx

    @property
    def length(self) -> int:
        """Modal forces of an atom."""
        return self.width * self.p

    def _prepare(self, m: int, d: int, places: int) -> KernelWork:
        nx = self.nx
        rows = nx + d + places * nx
        first = sum((KernelWork(2 * rows) + products(rows, i) for i in range(m)), KernelWork(0))
        known = nx + d  # of the states only what is of one of them
        ends = [rows if j < known else known + ((j - known) // nx + 1) * nx for j in range(rows)]
        second = sum((products(end - j, m) for j, end in enumerate(ends)), KernelWork(0))
        covariances = KernelWork(places * nx * (2 * nx + d))
        noise = KernelWork(7 * m * (m + 1) // 2)
        zeros = KernelWork(5 * m + d)  # what is told by when a force begins
        return noise + factoring(m) + readying(m) + first + second + covariances + zeros

    @cached_property
    def _look(self) -> KernelWork:
        nx, m = self.nx, self.m
        found = (
            KernelWork(m) + self._prepare(m, self.d, PLACES) + posterior_work(nx) + forward_solve(m)
        )
        if self.arrival == NONE:
            found += unknown_work(nx)
        if self.bounded:
            found += self.columns * (products(self.rows, self.length) + KernelWork(1))
        return found + products(self.rows, m) + products(nx, nx)

    def _append(self, s: int) -> KernelWork:
        nx, length = self.nx, self.length
        effect = products(self.rows, length) + products(nx, nx) + s * dots(length)
        row = products(s, nx) + forward_solve(s)
        pivot = 2 * dots(length) + 2 * dots(nx) + dots(s) + dots(nx + s) + KernelWork(13, 2, 1)
        return effect + row + pivot

    def _remove(self, s: int) -> KernelWork:
        return KernelWork(3 * s * s + 11 * s, s, s)

    def _minimise(self, s: int) -> KernelWork:
        return backward_solve(self.nx, self.nx + s)

    def _move(self, s: int) -> KernelWork:
        return KernelWork(10 * s, s)

    def _enter(self, s: int) -> KernelWork:
        leaves = KernelWork(2 * (self.nx + s)) + self._minimise(s) + self._move(s) + self._remove(s)
        return 2 * self._append(s) + leaves

    def _first(self) -> KernelWork:
        return products(self.nx, self.most) + self.nx * dots(self.nx)

    def _explain(self, rows: int) -> KernelWork:
        return products(rows, self.nx) + products(rows, self.most)

    def _gradients(self) -> KernelWork:
        return self.steps * products(self.atoms, self.length)

    def _violated(self) -> KernelWork:
        return KernelWork(7 * self.n + 3)

    @cached_property
    def _appended(self) -> KernelWork:
        return sum((self._append(s) for s in range(self.most)), KernelWork(0))

    @cached_property
    def _optimum(self) -> KernelWork:
        """Start, search, factors of the atoms, what they leave."""
        s = self.most
        checked = self._first() + self._explain(self.d) + self._gradients() + self._violated()
        turn = self._remove(s).or_(checked + self._enter(s))
        every = self._minimise(s) + self._move(s) + turn + KernelWork(2)
        end = self._first() + self._explain(self.d) + self._gradients()
        return (
            KernelWork(8 * self.n) + self._appended + self.limit * every + end + self._residuals()
        )

    def _residuals(self) -> KernelWork:
        m, d = self.m, self.d
        forces = KernelWork(self.n * (2 + 2 * self.length))
        fit = products(m, self.nx) + d * KernelWork(1 + 2 * m)
        found = self._first() + forces + fit + KernelWork(2 * m) + forward_solve(m)
        if self.bounded or self.varying:
            found += m * (dots(m) + KernelWork(2))
        return found

    def _gap(self) -> KernelWork:
        nx, c = self.nx, self.columns * self.bounded
        near = KernelWork(4 * self.n)
        least_squares = near + dots(self.m) + self._explain(nx) + dots(nx) + KernelWork(2)
        return least_squares + KernelWork(30 * self.n + 60 * c + 12, self.n + 1)

    def _within(self) -> KernelWork:
        """Limits: one after the other, each with a search of its own."""
        m, c, nx = self.m, self.columns, self.nx
        sizes = m * KernelWork(3 * nx * nx + 6, 0, 1)
        value = KernelWork(3 * m + 1)
        enter = m * (value + KernelWork(9, 2)) + c * KernelWork(20, 2)
        leave = KernelWork(4 * m + 20 * c + 12 * (m + c), 2 * c + m + c)
        again = self._look + self._optimum
        ends = m * (value + KernelWork(3)) + 4 * (KernelWork(4 * m) + again)
        return sizes + self._residuals() + self.limit * (enter + leave + again) + ends

    def _refit(self) -> KernelWork:
        s = self.most  # only an atom that would pass zero needs another pass
        counts = range(s + 1) if self.sided else (s,)
        passes = (self._minimise(s) + KernelWork(8 * s, s) + self._remove(s) for s in counts)
        pull = KernelWork(2 * self.most, self.most) + forward_solve(self.most)
        return pull + sum(passes, KernelWork(0))

    def _reweighted(self) -> KernelWork:
        """Every pass is an optimum of its own."""
        return self.passes * (self._optimum + KernelWork(9 * self.n, 2 * self.n, self.n))

    @cached_property
    def _candidates(self) -> Candidates:
        """Atoms that are exchanged."""
        quiet = self._first() + self._explain(self.d) + self._gradients()
        room = min(self.chosen, self.most)
        return Candidates(self.nx, self.n, self.d, self.length, room, self._gradients(), quiet)

    def _chosen(self) -> KernelWork:
        """Number of atoms: from those of the l1 norm, from none, and the better end again."""
        s = self._candidates.room
        again = s * self._append(self.most) + self._minimise(s) + KernelWork(2 * s + 3 * self.n)
        return self._candidates.searched + again + self._residuals()

    def _doubtful(self) -> KernelWork:
        first = max(self.most - self.n, 0)
        counts = [min(first + k, self.most) for k in range(self.n)]
        tried = sum((self._told_apart(s) for s in counts), KernelWork(0))
        return self._candidates.doubted + tried

    def _unbiased(self) -> KernelWork:
        moved = self._first() + self._explain(2 * self.nx) + KernelWork(2 * self.nx + self.columns)
        return self._refit() + KernelWork(self.most) + self._forces() + moved

    def _told_apart(self, s: int) -> KernelWork:
        """`cs_window_append` and `cs_window_told_apart`."""
        return self._append(s) + self._minimise(s) + KernelWork(3 * s + 3)

    def _alternatives(self) -> KernelWork:
        first = max(self.most - self.n, 0)
        counts = [min(first + k, self.most) for k in range(self.n)]
        return sum((self._told_apart(s) for s in counts), KernelWork(8 * self.n, self.n))

    def _spread(self) -> KernelWork:
        return self.forces * (KernelWork(self.most) + forward_solve(self.most) + dots(self.most))

    def _covariances(self, rows: int) -> KernelWork:
        nx, s = self.nx, self.most
        effects = sum((products(rows, i) for i in range(s)), KernelWork(0))
        own = nx * products(rows, nx) + s * products(rows, nx) + effects + KernelWork(s * rows)
        block = sum((products(nx - j, nx + s) for j in range(nx)), KernelWork(0))
        return own + rows // nx * block

    def _filtered(self) -> KernelWork:
        nx, s, outputs = self.nx, self.most, self.ny - self.limits
        rows = 2 * nx + self.p
        each = products(rows, self.length) + products(nx, nx)
        solved = products(rows, outputs) + KernelWork(outputs) + s * each + products(rows, s)
        states = 2 * products(nx, nx) + nx * dots(nx)
        tables = self._prepare(outputs, self.p, 1) + forward_solve(outputs) + posterior_work(nx)
        if self.bounded:
            tables += self.columns * (products(rows, self.p) + KernelWork(2))
        return tables + solved + states + self._covariances(nx)

    def _variances(self) -> KernelWork:
        s = self.most
        inverse = sum((products(i, i) + KernelWork(4 * (i + 1)) for i in range(s)), KernelWork(0))
        return inverse + KernelWork(s + s * (2 * s + 2))

    def _forces(self) -> KernelWork:
        spread_over = KernelWork(4 * self.n if self.correction else 0, 1, 1)
        each = KernelWork(4 + 4 * self.forces)
        return spread_over + KernelWork(4) + self.width * self.atoms * each

    def _kkt(self) -> KernelWork:
        return self._violated() + KernelWork(9 * self.most, self.most)

    @cached_property
    def whole(self) -> KernelWork:
        """All of ``cs_window``."""
        nx, own = self.nx, self.arrival in (NONE, FILTERED)
        found = KernelWork(2 * self.m) + self._look + self._first() + self._explain(self.d)
        found += self._gradients() + KernelWork(4 * self.n + 3) + self._optimum
        if self.bounded:
            found += self._within() + self._look + self._appended + KernelWork(3 * self.columns)
        if self.passes:
            found += self._reweighted()
        if self.chosen:
            found += self._chosen()
        found += self._kkt() + self._gap() + KernelWork(self.m if self.varying else 0)
        shown = (PLACES - own) * nx
        states = self._filtered() if own else KernelWork(0)
        states += self._explain(shown) + self._covariances(shown)
        forces = KernelWork(3 * self.n) + self._forces() + 2 * self._spread()
        alternatives = self._doubtful() if self.chosen else self._alternatives()
        fitted = self._unbiased() + alternatives + self._covariances(2 * nx)
        fitted += KernelWork(2 * nx * nx + 4 * self.forces + self.n)
        carried = self._variances() if self.carries else KernelWork(0)
        return found + carried + states + forces + fitted
