r"""Windows of a nonlinear model: linearised along a motion, solved exactly, and so on.

Along a motion :math:`\bar x, \bar d` the model of eq. 9-10 is

.. math:: x_{i+1} = f(\bar x_i, u_i, \bar d_i) + A_i (x_i - \bar x_i) + E_i (d_i - \bar d_i) + w_i,
    \qquad y_i = h(\bar x_i, u_i, \bar d_i) + C_i (x_i - \bar x_i) + F_i (d_i - \bar d_i) + v_i,

a window with matrices of its own for every sample, whose forces the same kernel finds by the exact
active set (Gauss-Newton). The motion that it finds is the one to linearise along in the next pass,
and, a sample later, in the next window: with one pass per sample every measurement is in N + 1.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.update import measured, noise_of
from backsight.engine import foreign
from backsight.engine.loops import scan
from backsight.estimators.cs_mhe._tables import SAME, Tables, atoms_of
from backsight.estimators.cs_mhe._window import Solver, WindowSolution
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.substeps import flow
from backsight.estimators.varied_noise import noise_at
from backsight.types import Array

STAGES, MOTION = "cs_window_stages", "cs_window_motion"
"""Kernels: tables of a window from its samples, and the motion from its solution."""

TRIED = 8
"""Random states at which the directions of the forces are looked at, for each of them."""


@dataclasses.dataclass(frozen=True)
class AlongSolution:
    """A window of a nonlinear model.

    Parameters
    ----------
    found : WindowSolution
    problem : list of MX
        Its tables, see `Solver.solve`.
    window : list of MX
        See `Solver.solve`.
    states : MX
        Motion without forces, (nx, samples + 1).
    X, forces : MX
        Motion found, (nx, samples + 1), and its modal forces, (p, samples).
    """

    found: WindowSolution
    problem: list[ca.MX]
    window: list[ca.MX]
    states: ca.MX
    X: ca.MX
    forces: ca.MX


@dataclasses.dataclass(frozen=True)
class Along:
    """Linearises the windows of a model along motions.

    Parameters
    ----------
    solver : Solver
    onto : (p, nf) array
        Of forces to the modal forces by which they act, see `directions`.
    passes : int
        Linearisations per sample.
    """

    solver: Solver
    onto: Array
    passes: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """What the kernels are told."""
        k = self.solver
        nx, ny = len(k.forced.system.s.sx), len(k.forced.system.s.sy) + len(k.limits.names)
        return nx, ny, k.tables.modal, k.tables.steps, k.N, k.lag

    def solve(
        self, X: ca.MX, forces: ca.MX, window: list[ca.MX], start: list[ca.MX], weights: list[ca.MX]
    ) -> AlongSolution:
        """Linearise, solve, and again.

        Parameters
        ----------
        X, forces : MX
            Motion to begin with, (nx, samples) and (p, samples).
        window : list of MX
            Absent samples, known forces (nf, samples), inputs, outputs and masks.
        start : list of MX
            First state, its covariance, and factors to start from.
        weights : list of MX
            See `Carryover.weights`.
        """
        warm = start[2]
        for _ in range(self.passes):
            made = self._solved(X, forces, window, [*start[:2], warm], weights)
            X, forces, warm = made.X[:, :-1], made.forces, made.found.alpha
        return made

    def _solved(
        self, X: ca.MX, forces: ca.MX, window: list[ca.MX], start: list[ca.MX], weights: list[ca.MX]
    ) -> AlongSolution:
        solver, samples = self.solver, self.solver.N + 1
        nx, ny, p, steps = self.sizes[:4]
        absent, tail, U, Y, M = window
        known = _onto(self.onto, samples)(tail) if tail.numel() else ca.MX.zeros(p, samples)
        counter = ca.MX(ca.DM(np.arange(samples, dtype=float)).T)
        (last, _), (states, residuals, A, E, C, F) = scan(
            linearised_sample(solver.forced, solver.limits, self.onto),
            samples,
            carry=[start[0], absent],
            xs=[counter, X, forces, known, U, Y, M],
        )
        s, (background, Q, R, sums) = solver.forced.system.s, self._noise()
        Q = ca.MX(noise_at(Q, [(part.index, part.Q) for part in s.parts], U[:, -1]))
        stages = [A, E, C, F, _constant(background), Q, _constant(R), _constant(sums), absent]
        rows, known_rows = ny * samples, steps * p
        shapes = [
            (rows, nx), (rows, known_rows), (rows, rows), (nx, nx * (samples + 1)),
            (nx, nx * (samples + 1)), (rows, nx * (samples + 1)), (nx, known_rows * (samples + 1)),
        ]  # fmt: skip
        problem = foreign.call(STAGES, self.sizes, inputs=stages, outputs=shapes)
        problem = [*problem, _constant(R)]
        given = [residuals, M, *solver.ends(states, residuals, M), absent]
        found = solver.solve(given, start[1], weights, start[2], problem)
        moved, acting = foreign.call(
            MOTION,
            self.sizes,
            inputs=[*stages, found.motion],
            outputs=[(nx, samples + 1), (p, samples)],
        )
        whole = ca.horzcat(states, last)
        X_next, forces_next = _sum(whole, moved), _sum(known, acting)
        return AlongSolution(found, problem, given, whole, X_next, forces_next)

    def _noise(self) -> tuple[Array, Array, Array, Array]:
        """Covariances of modal background forces, states and outputs, and limited sums of noise."""
        forced, limits = self.solver.forced, self.solver.limits
        s, n = forced.system.s, len(limits.names)
        ny = len(s.sy)
        R = np.zeros((ny + n, ny + n))
        R[:ny, :ny] = s.R
        sums = np.vstack([np.zeros((ny, len(s.sx))), limits.noise])
        return (self.onto * forced.sigma**2) @ self.onto.T, s.Q, R, sums

    def innovation(self) -> ca.Function:
        """Innovation, 0 where not measured, and covariance: ``(x, P, u, y, mask) -> (e, S)``."""
        forced, onto, R = self.solver.forced, self.onto, ca.SX(ca.DM(self.solver.forced.system.s.R))
        background = ca.DM(self._noise()[0])

        def formula(x: ca.SX, whole: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
            f = ca.SX.sym("f", len(onto))
            expected = forced.system.s.model.output(x, _inputs(forced, onto, u, f))
            C, D = ca.jacobian(expected, x), ca.jacobian(expected, f)
            S = C @ whole @ C.T + D @ background @ D.T + noise_of(R, mask)
            still = [ca.substitute(k, f, ca.SX.zeros(len(onto))) for k in (expected, S)]
            return {"e": measured(mask) * (y - still[0]), "S": ca.densify(still[1])}

        s = forced.system.s
        nx = len(s.sx)
        return leaf("innovation", {**notation(s), "u": forced.nu, "whole": (nx, nx)}, formula)


def varying_tables(forced: Forced, shapes: Array, onto: Array, *, N: int) -> Tables:
    """What does not depend on the motion: the atoms, and sizes."""
    return Tables((), (), atoms_of(shapes, onto), len(onto), N + forced.direct)


def directions(forced: Forced) -> Array:
    """Forces onto what they act through, (p, nf): fewer numbers than forces if places share modes.

    Looked for at random states around the prior's mean; they must do at others, too, or every force
    is by itself.
    """
    s, nf, nu = forced.system.s, len(forced.names), forced.nu
    x, u, d = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", nu), ca.SX.sym("d", nf)
    given = ca.vertcat(u, d / s.su[nu:])
    both = ca.vertcat(s.model.rhs(x, given), s.model.output(x, given))
    slopes = ca.Function("slopes", [x, u, d], [ca.densify(ca.jacobian(both, d))])
    rng = np.random.default_rng(0)

    def look() -> Array:
        there = s.x0 + (1e-3 + np.sqrt(np.diag(s.P0))) * rng.standard_normal(len(s.x0))
        given = (there, rng.standard_normal(nu), 1e-3 * rng.standard_normal(nf))
        found = np.array(slopes(*given))
        size = np.linalg.norm(found, axis=1, keepdims=True)
        return found / np.where(size > 0, size, 1.0)

    rows = np.vstack([look() for _ in range(TRIED * nf)])
    if not np.isfinite(rows).all():
        return np.eye(nf)
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    onto = right[: int((values > SAME * values[0]).sum())]
    left = np.vstack([look() for _ in range(TRIED * nf)]) @ (np.eye(nf) - onto.T @ onto)
    return onto if np.abs(left).max() < 1e-9 else np.eye(nf)


def linearised_sample(forced: Forced, limits: Limits, onto: Array) -> ca.Function:
    """One sample of a window, and the motion without the forces that are looked for.

    ``(x, absent, i, x_bar, f_bar, tail, u, y, m) -> (x, absent, x, residuals, A, E, C, F)``;
    samples before the first one neither move the state nor differ.
    """
    s, nx, p = forced.system.s, len(forced.system.s.sx), len(onto)
    sizes = {
        "x": nx, "absent": 1, "i": 1, "x_bar": nx, "f_bar": p, "tail": p,
        "u": forced.nu, "y": len(s.sy), "m": len(s.sy),
    }  # fmt: skip
    given = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    x, absent, i, x_bar, f_bar, tail, u, y, m = given.values()
    x_end, A, E = _transition(forced, onto)(x_bar, u, f_bar)
    y_bar, C, F = _look(forced, limits, onto)(x_bar, u, f_bar)
    ny = len(s.sy)

    def formula(
        x: ca.SX, absent: ca.SX, i: ca.SX, x_bar: ca.SX, f_bar: ca.SX, tail: ca.SX, y: ca.SX,
        m: ca.SX, x_end: ca.SX, A: ca.SX, E: ca.SX, y_bar: ca.SX, C: ca.SX, F: ca.SX,
    ) -> Results:  # fmt: skip
        here, dx, df = i >= absent, x - x_bar, tail - f_bar
        moved = x_end + A @ dx + E @ df
        seen = y_bar + C[:ny, :] @ dx + F[:ny, :] @ df
        differ = ca.if_else(ca.logic_and(here, m > 0), m * (y - seen), 0)
        return {"x_next": ca.if_else(here, moved, x), "residual": differ}

    more = {"x_end": nx, "A": (nx, nx), "E": (nx, p), "y_bar": ny}
    rows = ny + len(limits.names)
    affine = leaf("affine", sizes | more | {"C": (rows, nx), "F": (rows, p)}, formula)
    x_next, differ = affine(x, absent, i, x_bar, f_bar, tail, y, m, x_end, A, E, y_bar, C, F)
    return ca.Function("sample", list(given.values()), [x_next, absent, x, differ, A, E, C, F])


def _transition(forced: Forced, onto: Array) -> ca.Function:
    """State a sample later and its derivatives: ``(x, u, f) -> (x_next, A, E)``."""
    s, nx, p = forced.system.s, len(forced.system.s.sx), len(onto)
    x, u, f = ca.SX.sym("x", nx), ca.SX.sym("u", forced.nu), ca.SX.sym("f", p)
    A, E, given = ca.SX.sym("A", nx, nx), ca.SX.sym("E", nx, p), _inputs(forced, onto, u, f)
    n = s.integrator.steps if s.model.continuous else 1
    if s.model.continuous:
        moved = flow(s, s.integrator, x, ua=given, ub=given, h=s.dt / n)
    else:
        moved = s.model.rhs(x, given)
    Phi, Gamma = ca.jacobian(moved, x), ca.jacobian(moved, f)
    ends = [moved, ca.densify(Phi @ A), ca.densify(Phi @ E + Gamma)]
    step = ca.Function("along_step", [x, A, E, u, f], ends)
    start, v, g = ca.MX.sym("x", nx), ca.MX.sym("u", forced.nu), ca.MX.sym("f", p)
    first = [start, ca.MX(ca.DM.eye(nx).full()), ca.MX(np.zeros((nx, p)))]
    found, _ = scan(step, n, carry=first, constants=[v, g])
    return ca.Function("along_transition", [start, v, g], found)


def _look(forced: Forced, limits: Limits, onto: Array) -> ca.Function:
    """Outputs, and derivatives of outputs and limited sums: ``(x, u, f) -> (y, C, F)``."""
    s, p = forced.system.s, len(onto)

    def formula(x: ca.SX, u: ca.SX, f: ca.SX) -> Results:
        y = ca.densify(s.model.output(x, _inputs(forced, onto, u, f)))
        C, F = ca.jacobian(y, x), ca.jacobian(y, f)
        weights = ca.DM(limits.residual)
        rows_C = ca.vertcat(C, ca.DM(limits.state) - weights @ C)
        return {
            "y_bar": y,
            "C": ca.densify(rows_C),
            "F": ca.densify(ca.vertcat(F, -weights @ F)),
        }

    return leaf("along_outputs", {"x": len(s.sx), "u": forced.nu, "f": p}, formula)


def _inputs(forced: Forced, onto: Array, u: ca.SX, f: ca.SX) -> ca.SX:
    """Scaled inputs of the model: known ones, and the forces that modal forces stand for."""
    return ca.vertcat(u, ca.DM(onto.T) @ f / forced.system.s.su[forced.nu :])


def _onto(onto: Array, samples: int) -> ca.Function:
    """Modal forces of forces (nf, samples)."""
    d = ca.SX.sym("d", onto.shape[1], samples)
    return ca.Function("onto", [d], [ca.densify(ca.DM(onto) @ d)])


def _constant(matrix: Array) -> ca.MX:
    return ca.MX(ca.DM(np.atleast_2d(matrix)))


def _sum(a: ca.MX, b: ca.MX) -> ca.MX:
    """Sum of two matrices as a leaf."""
    p, q = ca.SX.sym("p", *a.shape), ca.SX.sym("q", *a.shape)
    return ca.Function("sum_of_motions", [p, q], [p + q])(a, b)
