"""A window of a linear model with unknown forces in numbers, as the kernel `cs_window` takes it."""

import dataclasses
import math

import numpy as np
import scipy

from backsight.errors import TuningError
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.linear import root
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
        measured, and the atoms as modal forces, those transposed, and as forces.
    modal : int
        Numbers by which all forces of a step act together.
    steps : int
        Steps at which a force can begin.
    """

    problem: tuple[Array, ...]
    full: tuple[Array, ...]
    atoms: tuple[Array, ...]
    modal: int
    steps: int


def tables(forced: Forced, shapes: Array, *, N: int, lag: int) -> Tables:
    """Work out what does not depend on the data.

    Parameters
    ----------
    forced : Forced
    shapes : (forces, steps, atoms) array
        The dictionary.
    N : int
        Horizon.
    lag : int
        Samples from the end of the window to its output.
    """
    system = forced.system
    A, C = system.A, system.C
    nx = len(A)
    steps = N + forced.direct
    modes, onto = _modal(forced)
    noise = _noise(forced)
    p = modes.shape[1]
    by_noise, seen_noise = _responses(A, C, noise, N=N, steps=N + 1)
    by_force, seen_force = _responses(A, C, modes, N=N, steps=steps)
    powers = [np.eye(nx)]
    for _ in range(N + 1):
        powers.append(A @ powers[-1])
    start = np.vstack([C @ power for power in powers[:-1]])
    S0 = seen_noise @ seen_noise.T + np.kron(np.eye(N + 1), system.s.R)
    P = [x @ x.T for x in by_noise]
    cross = [seen_noise @ x.T for x in by_noise]
    moved = [power @ modes[:nx] for power in powers[:-1]]
    joined = map(np.hstack, (powers, P, cross, moved))
    problem = (start, seen_force, S0, *joined, system.s.R)

    factor = scipy.linalg.cho_factor(S0, lower=True)
    both = np.hstack([start, seen_force])
    Z = scipy.linalg.cho_solve(factor, both)
    gram = both.T @ Z
    gains, effects, variances = [Z.T], [gram], []
    for at in (1, N - lag, N + 1):
        gain = scipy.linalg.cho_solve(factor, cross[at]).T
        gains.append(gain)
        effects.append(gain @ both - np.hstack([powers[at], by_force[at]]))
        variances.append(P[at] - gain @ cross[at])
    full = tuple(map(np.vstack, (gains, effects, variances)))
    modal = np.einsum("pf,fwa->pwa", onto, shapes).reshape(-1, shapes.shape[2], order="F")
    atoms = (modal, modal.T, shapes.reshape(len(shapes), -1, order="F"))
    return Tables(problem, full, atoms, p, steps)


def _modal(forced: Forced) -> tuple[Array, Array]:
    """Effects of the modal forces on next state and output (nx + ny, p), and forces onto them."""
    both = np.vstack([forced.E, forced.F])
    size = np.linalg.norm(both, axis=1, keepdims=True)
    weights = np.where(size > 0, size, 1.0)
    left, values, right = np.linalg.svd(both / weights, full_matrices=False)
    rank = int((values > SAME * values[0]).sum())
    return weights * left[:, :rank] * values[:rank], right[:rank]


def _noise(forced: Forced) -> Array:
    """Root of the joint covariance of what the noise adds to next state and output."""
    nx = len(forced.E)
    both = np.vstack([forced.E, forced.F]) * forced.sigma
    joint = both @ both.T
    joint[:nx, :nx] += forced.system.s.Q
    return root(joint) if joint.any() else np.zeros((len(joint), 1))


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


def check_unbounded(model: Model) -> None:
    """Raise `TuningError` if a state has bounds: windows with forces know none."""
    bounded = [s.name for s in model.states if math.isfinite(s.lower) or math.isfinite(s.upper)]
    if bounded:
        raise TuningError(
            f"the model has bounds of {', '.join(bounded)}, which this estimator would not keep: "
            "take a model without them, or LinearMHE, whose limits are kept"
        )
