"""One window of the compressive-sensing estimator as functions of CasADi."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.engine import foreign
from backsight.engine.dense import UNROLL, applied, few_entries
from backsight.engine.loops import scan
from backsight.estimators.cs_mhe._arrival import LinearArrival, counted
from backsight.estimators.cs_mhe._limits import NO_LIMIT, limited_sample
from backsight.estimators.cs_mhe._tables import Tables
from backsight.estimators.cs_mhe.refinement import Refinement, kernel_numbers, sizes_of
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.covariance import Term
from backsight.estimators.parts.limits import Limits
from backsight.types import Array

KERNEL = "cs_window"
"""Finds the optimum."""

ROUNDING = 1e-9
"""Violation of an optimality condition, as a share of lam, that is no violation."""

SMALL = 1e-10
"""Duality gap, as a share of the cost, that is rounding, and need not be known more exactly."""

INFO = 9
"""Numbers that the kernel says of a window, and one more for every limited sum."""

STEPS_PER_ATOM = 4
"""The active set may take so many steps for every atom that can be active, and some more."""

OF_NOISE = (2, 4, 5)
"""Places of what follows from the process noise in `Tables.problem`."""

MARGIN = 16
"""Atoms that may be active beyond those that can be independent."""


@dataclasses.dataclass(frozen=True)
class WindowSolution:
    """What the kernel returns.

    Parameters
    ----------
    alpha, extra, variance : MX
        Factors of the atoms, their extra states, and the variance of the sum, (atoms, steps); the
        variance is 0 if nothing carries it on.
    x, P : list of MX
        Second state of the window, state of the output, state after the window: deviation from
        the motion without forces (nx, 1), covariance (nx, nx).
    forces : MX
        Over the step of the output: above the threshold, as found, their variance, (nf, 3).
    info : list of MX
        Status, violation of the optimality conditions, steps, active atoms, weight from which
        nothing is found, 1 if the window does not determine its first state, duality gap as a
        share of the cost, 1 if a limit is active, 1 if limits contradict each other.
    infeasible : MX
        1 for the limited sums that contradict each other or others.
    motion : MX
        Of a window with tables of its own: weighted residuals, modal forces, first state.
    """

    alpha: ca.MX
    extra: ca.MX
    variance: ca.MX
    x: list[ca.MX]
    P: list[ca.MX]
    forces: ca.MX
    info: list[ca.MX]
    infeasible: ca.MX
    motion: ca.MX


@dataclasses.dataclass(frozen=True)
class Solver:
    """The kernel with its constants.

    Parameters
    ----------
    forced : Forced
    tables : Tables
    shapes : (forces, steps, atoms) array
    N, lag : int
    lam : float
    side : (atoms,) array
        1 or -1 where a factor must not be negative or positive, else 0.
    threshold : float
    arrival : LinearArrival
    correction : int
        As the kernel counts it.
    carries : bool
        Whether the next window expects what was found: then variances are needed, and extra states,
        or priors, may keep atoms active beyond the independent ones.
    refits : bool
        Whether the forces found are then fitted without the l1 norm.
    limits : Limits
        Of states, residuals and noise.
    caps : (2, atoms) array
        Largest factors, and largest changes of those that are expected.
    at_most : (int, int), optional
        Steps of the active set and atoms in it, fewer than can be.
    refinement : Reweighting or Exchanges, optional
        What follows the l1 norm.
    group : (atoms steps,) array, optional
        See `groups_of`; every atom by itself if not given.
    """

    forced: Forced
    tables: Tables
    shapes: Array
    N: int
    lag: int
    lam: float
    side: Array
    threshold: float
    arrival: LinearArrival
    correction: int
    carries: bool
    refits: bool
    limits: Limits
    caps: Array
    at_most: tuple[int | None, int | None] = (None, None)
    refinement: Refinement | None = None
    group: Array | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Atoms per step, and steps."""
        return self.shapes.shape[2], self.tables.steps

    @property
    def sizes(self) -> tuple[int, ...]:
        """What the kernel is told of its problem."""
        nf, width, atoms = self.shapes.shape
        t, system, limits = self.tables, self.forced.system, len(self.limits.names)
        nx, ny = len(system.A), len(system.C) + limits
        parts = 2 if self.carries else 1
        most = min(parts * min(atoms, t.modal) * t.steps + MARGIN, parts * atoms * t.steps)
        steps, active = self.at_most
        most = min(most, active or most)
        limit = steps or STEPS_PER_ATOM * t.modal * t.steps + 100
        options = limit, counted(self.arrival), self.correction, int(self.carries)
        bounded = bool(limits or self.caps.min() < NO_LIMIT)
        known = nx, ny, t.modal, width, atoms, t.steps, self.N, nf, most, *options
        kinds = limits, int(bounded), int(not t.full), int(self.side.any())
        return *known, *kinds, *sizes_of(self.refinement)

    def solve(
        self,
        window: list[ca.MX],
        P: ca.MX,
        weights: list[ca.MX],
        warm: ca.MX,
        problem: Sequence[ca.MX] = (),
    ) -> WindowSolution:
        """Solve a window.

        Parameters
        ----------
        window : list of MX
            Residuals and masks (ny, N + 1), ends of the limits (n, N + 1), see `ends`, and the
            number of samples that are absent.
        P : MX
            Covariance of the first state, (nx, nx).
        weights : list of MX
            See `Carryover.weights`.
        warm : MX
            Factors to start from, (atoms, steps).
        problem : sequence of MX
            Tables of this window, if they are not always the same.
        """
        nx, nf = len(self.forced.system.A), len(self.forced.names)
        options = [self.threshold, ROUNDING * self.lam, float(self.lag), float(self.refits), SMALL]
        full = self.tables.full or [np.zeros((1, 1))] * 4
        side = np.tile(self.side, self.tables.steps)
        group = np.arange(len(side)) if self.group is None else self.group
        options += kernel_numbers(self.refinement, len(side))
        constants = [*full, *self.tables.atoms, side, self.caps.T, group, np.array(options)]
        given = [ca.MX(ca.DM(a)) for a in constants]
        told = [*problem] or [ca.MX(ca.DM(a)) for a in self.tables.problem]
        rows = (len(self.limits.names) + len(self.forced.system.C)) * (self.N + 1)
        motion = rows + self.tables.modal * self.tables.steps + nx if problem else 1
        said = INFO + len(self.limits.names)
        shapes = [self.shape] * 3 + [(nx, 3), (nx, 3 * nx), (nf, 3), (said, 1), (motion, 1)]
        alpha, extra, variance, x, P_all, forces, info, found = foreign.call(
            KERNEL,
            self.sizes,
            inputs=[*told, *given, *window, P, *weights, warm],
            outputs=shapes,
        )
        return WindowSolution(
            alpha,
            extra,
            variance,
            ca.horzsplit(x),
            ca.horzsplit(P_all, nx),
            forces,
            ca.vertsplit(info[:INFO]),
            info[INFO:],
            found,
        )

    def problem_at(self, u: ca.MX) -> list[ca.MX]:
        """Tables of a window at inputs that multiply noise, for `solve`; none if nothing does.

        Covariances of the outputs of a window, of its states, and of both are linear in that of the
        noise.
        """
        if not self.tables.parts:
            return []
        found = [ca.MX(ca.DM(a)) for a in self.tables.problem]
        for part, added in zip(self.forced.system.s.parts, self.tables.parts, strict=True):
            a, b = part.index
            for place, matrix in zip(OF_NOISE, added, strict=True):
                found[place] = found[place] + u[a] * u[b] * ca.MX(ca.DM(matrix))
        return found

    def ends(self, states: ca.MX, residuals: ca.MX, M: ca.MX) -> list[ca.MX]:
        """Ends of the limits of all samples, (n, samples) each, less what the motion is.

        Parameters
        ----------
        states, residuals, M : MX
            Motion without forces, residuals of it times the weights of the samples, weights.
        """
        if not self.limits.names:
            return [ca.MX(0), ca.MX(0)]
        samples = self.N + 1
        last = ca.MX(ca.DM(np.eye(samples)[-1:]))
        body = limited_sample(self.limits)
        return scan(body, samples, carry=[ca.MX(0)], xs=[states, residuals, M, last])[1]


def window_motion(forced: Forced, samples: int, known: int) -> ca.Function:
    """Motion from the first state by the known inputs, and what the outputs differ from it.

    ``(x, absent, tail, U, Y, M) -> (residuals, states, state after the window)``; absent samples
    at the beginning neither move the state nor differ. Forces `tail` (known, samples) are those
    known already; `known` is 0 or the number of forces.
    """
    system = forced.system
    (ny, nx), nu = system.C.shape, forced.nu
    sizes = {"x": nx, "absent": 1, "i": 1, "tail": known, "u": nu, "v": nu, "y": ny, "m": ny}
    kind = ca.MX if nx > UNROLL else ca.SX
    s: dict[str, Any] = {name: kind.sym(name, size) for name, size in sizes.items()}
    here = s["i"] >= s["absent"]
    y = s["y"] - _times(system.C, s["x"]) - _times(system.D[:, :nu], s["u"])
    x = _times(system.A, s["x"]) + _times(system.B[:, :nu], s["u"])
    x += _times(system.B_next[:, :nu], s["v"])
    if known:
        y -= _times(forced.F, s["tail"])
        x += _times(forced.E, s["tail"])
    order = [s[n] for n in ("x", "absent", "i", "tail", "u", "v", "y", "m")]
    results = [ca.if_else(here, x, s["x"]), s["absent"], s["m"] * here * y, s["x"]]
    leaf = ca.Function("motion_step", order, results)
    first, absent = ca.MX.sym("x", nx), ca.MX.sym("absent")
    columns = [ca.MX.sym(n, sizes[n], samples) for n in ("tail", "u", "y", "m")]
    tail, U, Y, M = columns
    V = ca.horzcat(U[:, 1:], ca.MX.zeros(nu, 1))
    counter = ca.MX(ca.DM(np.arange(samples, dtype=float)).T)
    (last, _), (residuals, states) = scan(
        leaf, samples, carry=[first, absent], xs=[counter, tail, U, V, Y, M]
    )
    return ca.Function("motion", [first, absent, *columns], [residuals, states, last])


def begun_before(solver: Solver, alpha: ca.MX) -> ca.MX:
    """Forces that atoms of the step before a window still do in it, (forces, samples)."""
    nf, width, _ = solver.shapes.shape
    symbol = ca.SX.sym("alpha", alpha.numel())
    columns = [_times(solver.shapes[:, k, :], symbol) for k in range(1, width)]
    columns.append(ca.SX.zeros(nf, solver.N + 2 - width))
    shape = ca.Function("begun_before", [symbol], [ca.densify(ca.horzcat(*columns))])
    return shape(alpha)


def _times(matrix: Array, vector: Term) -> Term:
    if isinstance(vector, ca.MX):
        return applied(few_entries(matrix), vector)
    return ca.densify(ca.mtimes(ca.sparsify(ca.DM(matrix)), vector))
