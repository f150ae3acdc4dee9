"""What a window of ``cs_window.c`` costs at most: its functions, in its order, under their names.

Everything that may be active is: as many atoms as there is room for.
"""

import dataclasses
from functools import cached_property

from backsight.kernels._operations import Operations

NONE, FILTERED = 0, 2
"""Arrival costs as `cs_window_tables.h` counts them."""

PLACES = 3


def window_effort(*sizes: int) -> Operations:
    """Largest number of operations of one window."""
    return Window(*sizes).whole


def _product(rows: int, n: int) -> Operations:
    return Operations(n * (2 * rows + 1))


def _dot(n: int) -> Operations:
    return Operations(2 * n + 1)


def _factor(n: int) -> Operations:
    return Operations(sum(2 + j + 2 * (n - j) * j + n - j for j in range(n)), n, n)


def _ready(n: int) -> Operations:
    return Operations(n, n)


def _forward(n: int) -> Operations:
    return Operations(n * n + n + 1)


def _backward(first: int, n: int) -> Operations:
    return Operations(n * n - first * first + n + first + 2)


def _posterior(n: int) -> Operations:
    """`cs_window_posterior`."""
    right = sum((_product(n, n - j) for j in range(n)), Operations(0))
    both = sum(((i + 1) * (_dot(n - i) + Operations(1)) for i in range(n)), Operations(0))
    return 2 * _factor(n) + right + both + _ready(n) + n * _forward(n)


def _unknown(n: int) -> Operations:
    """`cs_window_unknown`."""
    return _factor(n) + Operations(3 * n) + _ready(n) + n * _forward(n)


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

    @property
    def m(self) -> int:
        """Rows of all measurements."""
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
    def rows(self) -> int:
        """Rows of the tables."""
        return self.nx + self.d + PLACES * self.nx

    @property
    def length(self) -> int:
        """Modal forces of an atom."""
        return self.width * self.p

    def _prepare(self, m: int, d: int, places: int) -> Operations:
        nx = self.nx
        rows = nx + d + places * nx
        first = sum((Operations(2 * rows) + _product(rows, i) for i in range(m)), Operations(0))
        second = sum((_product(rows - j, m) for j in range(rows)), Operations(0))
        covariances = Operations(places * nx * (2 * nx + d))
        noise = Operations(7 * m * m)
        return noise + _factor(m) + _ready(m) + first + second + covariances

    def _append(self, s: int) -> Operations:
        nx, length = self.nx, self.length
        effect = _product(self.rows, length) + _product(nx, nx) + s * _dot(length)
        row = _product(s, nx) + _forward(s)
        pivot = 2 * _dot(length) + 2 * _dot(nx) + _dot(s) + _dot(nx + s) + Operations(13, 2, 1)
        return effect + row + pivot

    def _remove(self, s: int) -> Operations:
        return Operations(3 * s * s + 11 * s, s, s)

    def _minimise(self, s: int) -> Operations:
        return _backward(self.nx, self.nx + s)

    def _move(self, s: int) -> Operations:
        return Operations(10 * s, s)

    def _enter(self, s: int) -> Operations:
        leaves = Operations(2 * (self.nx + s)) + self._minimise(s) + self._move(s) + self._remove(s)
        return 2 * self._append(s) + leaves

    def _first(self) -> Operations:
        return _product(self.nx, self.most) + self.nx * _dot(self.nx)

    def _explain(self, rows: int) -> Operations:
        return _product(rows, self.nx) + _product(rows, self.most)

    def _gradients(self) -> Operations:
        return self.steps * _product(self.atoms, self.length)

    def _violated(self) -> Operations:
        return Operations(7 * self.n + 3)

    def _look(self) -> Operations:
        tables = self._prepare(self.m, self.d, PLACES) + _posterior(self.nx)
        tables += _unknown(self.nx) if self.arrival == NONE else Operations(0)
        held = self.n * 2 * _product(self.rows, self.length) if self.bounded else Operations(0)
        data = Operations(self.m) + _forward(self.m) + _product(self.rows, self.m)
        return tables + data + held + _product(self.nx, self.nx)

    def _residuals(self) -> Operations:
        forces = Operations(2 * self.n + 2 * self.most * self.length)
        white = self.m * (Operations(2) + _dot(self.nx) + _dot(self.d))
        if not self.bounded and not self.varying:
            return self._first() + forces + white
        back = sum((_dot(j) + Operations(2) for j in range(self.m)), Operations(0))
        fit = _product(self.m, self.nx) + Operations(self.d + 2 * self.d * self.m)
        return self._first() + forces + white + back + fit

    def _gap(self) -> Operations:
        boxes = Operations(60 * self.n * (1 + self.carries) if self.bounded else 0)
        square = self._explain(self.nx) + _dot(self.m) + _dot(self.nx)
        return square + Operations(22 * self.n + 12, self.n + 1) + boxes

    def _limited(self) -> Operations:
        """`cs_window_within`: as many passes as the search may have steps, and the last ones."""
        if not self.bounded:
            return Operations(0)
        passes, columns = 2 * self.limit + 5, self.n * (1 + self.carries)
        choice = self.m * (Operations(3 * self.m + 8, 2)) + Operations(20 * columns + 9 * self.m)
        leave = Operations(12 * (self.m + columns), self.m + columns)
        again = self._look() + self._start + self._residuals() + choice + leave
        start = Operations(self.m * (4 * self.nx * self.nx + 6), 0, self.m)
        return start + passes * again + 7 * self._search() + self._look() + self._start

    @cached_property
    def _start(self) -> Operations:
        entering = sum((self._append(s) for s in range(self.most)), Operations(0))
        return Operations(8 * self.n) + entering

    def _search(self) -> Operations:
        s = self.most
        checked = self._first() + self._explain(self.d) + self._gradients() + self._violated()
        turn = self._remove(s).or_(checked + self._enter(s))
        every = self._minimise(s) + self._move(s) + turn + Operations(2)
        return self.limit * every + self._first() + self._explain(self.d) + self._gradients()

    def _refit(self) -> Operations:
        s = self.most  # only an atom that would pass zero needs another pass
        counts = range(s + 1) if self.sided else (s,)
        passes = (self._minimise(s) + Operations(8 * s, s) + self._remove(s) for s in counts)
        pull = Operations(2 * self.most, self.most) + _forward(self.most)
        return pull + sum(passes, Operations(0))

    def _alternatives(self) -> Operations:
        free = min(self.n, self.most)
        tried = sum((self._append(s) for s in range(self.most - free, self.most)), Operations(0))
        return Operations(8 * self.n, self.n) + tried + (self.n - free) * self._append(self.most)

    def _spread(self) -> Operations:
        return self.forces * (Operations(self.most) + _forward(self.most) + _dot(self.most))

    def _covariances(self, rows: int) -> Operations:
        nx, s = self.nx, self.most
        effects = sum((_product(rows, i) for i in range(s)), Operations(0))
        own = nx * _product(rows, nx) + s * _product(rows, nx) + effects + Operations(s * rows)
        block = sum((_product(nx - j, nx + s) for j in range(nx)), Operations(0))
        return own + rows // nx * block

    def _filtered(self) -> Operations:
        nx, s = self.nx, self.most
        rows = 2 * nx + self.p
        each = _product(rows, self.length) + _product(nx, nx)
        held = self.atoms * _product(rows, self.p) if self.bounded else Operations(0)
        solved = _forward(self.ny) + _product(rows, self.ny) + s * each + _product(rows, s) + held
        states = 2 * _product(nx, nx) + nx * _dot(nx)
        tables = self._prepare(self.ny, self.p, 1) + _posterior(nx)
        return tables + solved + states + self._covariances(nx)

    def _variances(self) -> Operations:
        s = self.most
        inverse = sum((_product(i, i) + Operations(4 * (i + 1)) for i in range(s)), Operations(0))
        return inverse + Operations(s + s * (2 * s + 2))

    def _forces(self) -> Operations:
        spread_over = Operations(4 * self.n if self.correction else 0, 1, 1)
        each = Operations(4 + 4 * self.forces)
        return spread_over + Operations(4) + self.width * self.atoms * each

    def _kkt(self) -> Operations:
        return self._violated() + Operations(9 * self.most, self.most)

    @cached_property
    def whole(self) -> Operations:
        """All of ``cs_window``."""
        nx, own = self.nx, self.arrival in (NONE, FILTERED)
        begin = Operations(3 * self.m) + self._look() + self._residuals() + self._gap()
        begin += self._limited() + Operations(self.m if self.varying else 0)
        begin += (
            self._first() + self._explain(self.d) + self._gradients() + Operations(4 * self.n + 3)
        )
        states = self._filtered() if own else Operations(0)
        shown = (PLACES - own) * nx
        states += self._first() + self._explain(shown) + self._covariances(shown) + self._kkt()
        forces = Operations(3 * self.n) + 2 * self._forces() + 2 * self._spread()
        fitted = self._refit() + self._first() + self._explain(2 * nx) + self._alternatives()
        fitted += self._covariances(2 * nx) + Operations(
            2 * nx * nx + 2 * nx + 4 * self.forces + self.n
        )
        carried = self._variances() if self.carries else Operations(0)
        return begin + self._start + self._search() + carried + states + forces + fitted


def stages_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> Operations:
    """Largest number of operations of ``cs_window_stages``."""
    d, m = p * steps, ny * (N + 1)
    noise = 2 * p * _product(nx, p) + p * _product(ny, nx + p) + nx * _product(nx, p)
    noise += ny * (_product(nx, p + nx) + _product(ny, p + nx)) + nx * _product(ny, nx)
    outputs = nx * _product(ny, nx) + d * _product(ny, nx) + Operations(2 * d * ny)
    outputs += m * _product(ny, nx) + (nx + ny) * _product(ny, nx)
    states = nx * _product(nx, nx) + d * _product(nx, nx) + Operations(2 * p * nx)
    states += nx * _product(m, nx) + 2 * nx * _product(nx, nx) + ny * _product(nx, nx)
    ahead = 2 * (N + 1) * nx * (_product(ny, nx) + _product(nx, nx))
    return (N + 1) * (noise + outputs + states + Operations(4)) + ahead


def motion_effort(nx: int, ny: int, p: int, _: int, N: int, __: int) -> Operations:
    """Largest number of operations of ``cs_window_motion``."""
    back = nx * (_dot(nx) + _dot(ny) + Operations(1))
    ahead = nx * (_dot(ny) + Operations(1)) + p * (_dot(nx) + _dot(ny) + Operations(2))
    ahead += _product(p, p) + 2 * _product(nx, nx) + _product(nx, p)
    return (N + 1) * (back + ahead)
