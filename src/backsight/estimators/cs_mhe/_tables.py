"""A window of a linear model with unknown forces in numbers, as the kernel `cs_window` takes it."""

import dataclasses

import numpy as np
import scipy

from backsight.errors import ModelError, TuningError
from backsight.estimators.force_estimator import AbstractDictionary, Forced
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.linear import root
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.model import Model
from backsight.types import Array

SAME = 1e-10
"""Forces whose effects differ by less than this share of the largest act alike."""


@dataclasses.dataclass(frozen=True)
class Tables:
    """Constants of `cs_window`.

    Parameters
    ----------
    problem, full, atoms : tuple of arrays
        Arguments of the kernel, in order: what a window is, what follows where every sample was
        measured and no limit is active, and the atoms as modal forces, those transposed, and as
        forces.
    modal : int
        Numbers by which all forces of a step act together.
    steps : int
        Steps at which a force can begin.
    parts : tuple of tuples of arrays
        What noise that inputs multiply adds to three arrays of `problem`, see `Solver.problem_at`;
        nothing then follows without knowing these inputs, and `full` is empty.
    """

    problem: tuple[Array, ...]
    full: tuple[Array, ...]
    atoms: tuple[Array, ...]
    modal: int
    steps: int
    parts: tuple[tuple[Array, ...], ...] = ()


def tables(forced: Forced, shapes: Array, limits: Limits, *, N: int, lag: int) -> Tables:
    """Work out what does not depend on the data.

    Parameters
    ----------
    forced : Forced
    shapes : (forces, steps, atoms) array
        The dictionary.
    limits : Limits
    N : int
        Horizon.
    lag : int
        Samples from the end of the window to its output.
    """
    system = forced.system
    A, nx, n = system.A, len(system.A), len(limits.names)
    C = np.vstack([system.C, limits.state - limits.residual @ system.C])
    steps = N + forced.direct
    forces, onto = modal_forces(np.vstack([forced.E, forced.F]))
    modes = np.vstack([forces, -limits.residual @ forces[nx:]])
    R = scipy.linalg.block_diag(system.s.R, np.zeros((n, n)))
    p = modes.shape[1]
    by_force, seen_force = _responses(A, C, modes, N=N, steps=steps)
    powers = [np.eye(nx)]
    for _ in range(N + 1):
        powers.append(A @ powers[-1])
    start = np.vstack([C @ power for power in powers[:-1]])

    def of_noise(joint: Array) -> tuple[list[Array], ...]:
        """Covariances of outputs, states, and both, by the joint one of next state and output."""
        noise = root(joint) if joint.any() else np.zeros((len(joint), 1))
        noise = np.vstack([noise, limits.noise @ noise[:nx] - limits.residual @ noise[nx:]])
        by_noise, seen = _responses(A, C, noise, N=N, steps=N + 1)
        return [seen @ seen.T], [x @ x.T for x in by_noise], [seen @ x.T for x in by_noise]

    (S0,), P, cross = of_noise(_noise(forced))
    S0 = S0 + np.kron(np.eye(N + 1), R)
    moved = [power @ modes[:nx] for power in powers[:-1]]
    joined = map(np.hstack, (powers, P, cross, moved))
    problem = (start, seen_force, S0, *joined, R)
    if system.s.parts:
        pairs = [
            [of_noise(_joint(forced, Q)) for Q in _definite(part.Q)] for part in system.s.parts
        ]
        added = [[np.hstack(a) - np.hstack(b) for a, b in zip(*p, strict=True)] for p in pairs]
        parts = tuple(map(tuple, added))
        return Tables(problem, (), atoms_of(shapes, onto), p, steps, parts)

    outputs = np.tile(np.arange(len(C)) < len(system.C), N + 1)
    factor = scipy.linalg.cholesky(S0[np.ix_(outputs, outputs)], lower=True)
    both = np.hstack([start, seen_force])[outputs]
    white = scipy.linalg.solve_triangular(factor, both, lower=True)
    halves, effects, variances = [white.T], [white.T @ white], []
    for at in (1, N - lag, N + 1):
        half = scipy.linalg.solve_triangular(factor, cross[at][outputs], lower=True).T
        halves.append(half)
        effects.append(half @ white - np.hstack([powers[at], by_force[at]]))
        variances.append(P[at] - half @ half.T)
    whole = scipy.linalg.solve_triangular(factor, np.vstack(halves).T, lower=True, trans="T").T
    np.fill_diagonal(factor, 1 / np.diag(factor))
    full = (whole, *map(np.vstack, (effects, variances)), factor)
    return Tables(problem, full, atoms_of(shapes, onto), p, steps)


def atoms_of(shapes: Array, onto: Array) -> tuple[Array, ...]:
    """The atoms of a dictionary as modal forces, those transposed, and as forces."""
    found = np.einsum("pf,fwa->pwa", onto, shapes).reshape(-1, shapes.shape[2], order="F")
    return found, found.T, shapes.reshape(len(shapes), -1, order="F")


def modal_forces(both: Array) -> tuple[Array, Array]:
    """Effects of modal forces (n, p), and forces onto them (p, nf), of the effects (n, nf)."""
    size = np.linalg.norm(both, axis=1, keepdims=True)
    weights = np.where(size > 0, size, 1.0)
    left, values, right = np.linalg.svd(both / weights, full_matrices=False)
    rank = int((values > SAME * values[0]).sum())
    return weights * left[:, :rank] * values[:rank], right[:rank]


def _noise(forced: Forced) -> Array:
    """Joint covariance of what the noise adds to next state and output."""
    both = np.vstack([forced.E, forced.F]) * forced.sigma
    return both @ both.T + _joint(forced, forced.system.s.Q)


def _joint(forced: Forced, Q: Array) -> Array:
    """The same of noise of the states alone."""
    nx, ny = len(Q), len(forced.F)
    return np.block([[Q, np.zeros((nx, ny))], [np.zeros((ny, nx + ny))]])


def _definite(Q: Array) -> tuple[Array, Array]:
    """Two positive semidefinite matrices whose difference is a symmetric one."""
    values, V = np.linalg.eigh(Q)
    plus = (V * np.maximum(values, 0)) @ V.T
    return plus, plus - Q


def _responses(A: Array, C: Array, effects: Array, *, N: int, steps: int) -> tuple[Array, Array]:
    """Responses of N + 2 states, and of all outputs on top of each other, to what acts at steps."""
    nx, ny, k = len(A), len(C), effects.shape[1]
    states, outputs = np.zeros((N + 2, nx, steps * k)), np.zeros((N + 1, ny, steps * k))
    for i in range(N + 1):
        outputs[i], states[i + 1] = C @ states[i], A @ states[i]
        if i < steps:
            own = slice(i * k, (i + 1) * k)
            states[i + 1][:, own] += effects[:nx]
            outputs[i][:, own] += effects[nx:]
    return states, outputs.reshape(-1, steps * k)


def shapes_within(dictionary: AbstractDictionary, forces: int, N: int) -> Array:
    """Atoms of a dictionary, (forces, steps, atoms); raise `TuningError` if N is too short."""
    shapes = dictionary.shapes(forces)
    if shapes.shape[1] > N:
        raise TuningError(
            f"the dictionary has atoms of {shapes.shape[1]} steps; the window of N = {N} is too "
            "short for them"
        )
    return shapes


def check_forces(forced: Forced, N: int) -> None:
    """Raise `TuningError` if a force moves nothing, or no sensor sees it within the window."""
    both = np.vstack([forced.E, forced.F])
    still = [n for n, column in zip(forced.names, both.T, strict=True) if not column.any()]
    if still:
        raise TuningError(
            f"force {', '.join(still)} moves no state of the model (a node of all its modes?); "
            "leave it out, or take more modes"
        )
    seen, x = np.abs(forced.F).max(axis=0), forced.E
    for _ in range(N):
        seen = np.maximum(seen, np.abs(forced.system.C @ x).max(axis=0))
        x = forced.system.A @ x
    least = SAME * max(seen.max(), np.finfo(float).tiny)
    unseen = [n for n, size in zip(forced.names, seen, strict=True) if not size > least]
    if unseen:
        raise TuningError(
            f"no sensor sees the force {', '.join(unseen)} within a window of N = {N}; add a "
            "sensor that moves with it"
        )


def with_forces_as_inputs(model: Model, forces: tuple[str, ...]) -> Model:
    """The model with its unknown forces as the last inputs; raise `TuningError` if it lacks one."""
    try:
        return forces_as_inputs(model, forces)
    except ModelError as error:
        raise TuningError(f"forces: {error}") from None
