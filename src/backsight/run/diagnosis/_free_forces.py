"""Which states are constants and which are forces that nothing but a random walk moves."""

import dataclasses

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.estimators.uncertainty import Noise
from backsight.models.model import Model


def constants_and_forces(model: Model, noise: Noise) -> tuple[list[int], list[int]]:
    """Places among the states of the constants, and of the free forces.

    A constant has neither dynamics nor process noise. A free force has process noise, is driven by
    no input and by no other state that moves, and moves others (or is a walk that only outputs
    show, like a drift of a sensor). A parameter that walks counts as one. A force with dynamics has
    a size of its own and is neither.
    """
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    change = model.rhs(x, u) if model.continuous else model.rhs(x, u) - x
    by_state, by_input = (_pattern(change, of) for of in (x, u))
    walks = np.diag(noise.process(model) + noise.density(model)) > 0
    still = ~by_state.any(axis=1) & ~by_input.any(axis=1)
    constant = still & ~walks
    # What a state depends on, directly or through others; constants do not count.
    reach = (by_state & ~constant) | np.eye(model.nx, dtype=bool)
    for _ in range(model.nx.bit_length()):
        reach = reach @ reach
    driven = (reach @ by_input).any(axis=1) if model.nu else np.zeros(model.nx, bool)
    own = reach & reach.T
    alone = (reach == own).all(axis=1)
    drives = (reach & ~own).any(axis=0)
    sized = np.isin([s.name for s in model.states], [n for g in model.driven for n in g.states])
    force = walks & alone & ~driven & (drives | still) & ~sized
    constant &= ~sized
    return np.flatnonzero(constant).tolist(), np.flatnonzero(force).tolist()


def with_walks(noise: Noise, model: Model, *, forces: list[int], factor: float) -> Noise:
    """Noise with the deviations of the walks of some states multiplied by a factor."""
    by = np.ones(model.nx)
    by[forces] = factor
    scale = np.outer(by, by)
    if noise.Qc is not None:
        return dataclasses.replace(noise, Qc=noise.stated_density(model) * scale)
    return dataclasses.replace(noise, sigma_w=None, Q=noise.stated_process(model) * scale)


def _pattern(rows: ca.SX, by: ca.SX) -> NDArray[np.bool_]:
    pattern = ca.DM(ca.jacobian(rows, by).sparsity(), 1)
    return np.array(ca.densify(pattern)).reshape(rows.shape[0], by.shape[0]).astype(bool)
