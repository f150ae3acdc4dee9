"""Can the outputs determine the states? Which cannot be seen, and which sensor would mend it."""

from collections.abc import Mapping

import numpy as np
import scipy

from backsight.analysis.observability._combinations import combinations, direction_in_words
from backsight.analysis.observability._seen import Observability
from backsight.analysis.observability._sensitivity import sensitivities
from backsight.analysis.observability._sensors import Sensor, repairs
from backsight.description import Positive, checked
from backsight.discrete.modes import modes_over
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import settle_steps
from backsight.errors import ModelError
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.types import Array

LINEAR_TOLERANCE = 1e-9
"""Singular values below this share of the largest are zero, for linear models."""

WINDOW_TOLERANCE = 1e-8
"""The same along a trajectory, whose sensitivities are rounded more often."""


@checked(ModelError)
def check_observability(
    model: Model,
    *,
    candidates: Mapping[str, Sensor] | None = None,
    tolerance: Positive = LINEAR_TOLERANCE,
) -> Observability:
    """Judge a linear model.

    The unobservable subspace is found by orthogonal projections of A, one block of the
    observability matrix after the other, without powers of A; detectability by the eigenvalues of
    A in that subspace (the test of Popov, Belevitch and Hautus).

    Parameters
    ----------
    model : Model
        Linear.
    candidates : dict, optional
        Name to sensor that could be added; every state by itself if not given.
    tolerance : float
        Share of the largest singular value below which one counts as zero.

    Raises
    ------
    ModelError
        If the model is not linear; use `check_observability_along`.

    Examples
    --------
    >>> bs.check.check_observability(bs.sdof(k=40.0, b=0.8)).observable
    True
    """
    A, _, C, _ = state_space(model)
    _, (size, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    balanced = A * size / size[:, None]
    basis, samples, weakest = unseen(balanced, C * size, tolerance)
    lasting = lasting_modes(balanced, basis, size, model)
    mending = repairs(
        model,
        candidates,
        basis,
        lambda m: unseen(balanced, state_space(m)[2] * size, tolerance)[0],
    )
    return Observability(
        model=model.name,
        states=tuple(s.name for s in model.states),
        rank=model.nx - basis.shape[1],
        samples=samples,
        weakest=weakest,
        tolerance=tolerance,
        hidden=combinations(basis, model.states, size),
        lasting=lasting,
        repairs=mending,
        window=0,
    )


def check_observability_along(
    model: Model,
    u: Array,
    *,
    dt: float,
    x0: Array | None = None,
    integrator: Integrator | None = None,
    walks: Mapping[str, float] | None = None,
    candidates: Mapping[str, Sensor] | None = None,
    tolerance: float = WINDOW_TOLERANCE,
) -> Observability:
    """Judge a model along the motion that it makes from a start under given inputs.

    Every output of every sample is differentiated by the first state; the singular values of
    these rows, states and outputs scaled to their sizes, say which combinations the window
    determines (they are the roots of the eigenvalues of its Gramian).

    Parameters
    ----------
    model : Model
    u : (n, nu) array
        Inputs of the window.
    dt : float
        Sampling period [s].
    x0 : (nx,) array, optional
        First state; the values in the model if not given.
    walks : dict, optional
        Standard deviation of what is added to states from sample to sample [their units], such as
        the walk of an unknown force: it moves a machine that has no recorded input. Drawn from a
        fixed seed.
    integrator, candidates, tolerance
        As elsewhere; see `check_observability`.

    Raises
    ------
    ModelError
        If the motion does not stay finite.

    Examples
    --------
    >>> import numpy as np
    >>> joint = bs.augment(bs.sdof(k=40.0, b=0.8), parameters=["k"])
    >>> bs.check.check_observability_along(joint, np.ones((50, 1)), dt=0.05).observable
    True
    """
    start = np.array([s.value for s in model.states]) if x0 is None else np.asarray(x0, float)
    given = Integrator() if integrator is None else integrator

    def rows(m: Model) -> tuple[Array, Array]:
        method = settle_steps(given, m, lambda: modes_over(m, start, np.zeros(m.nx)), dt=dt)
        return sensitivities(m, u, dt=dt, x0=start, integrator=method, pushes=pushes)

    pushes = _pushes(model, walks or {}, len(u))
    stack, size = rows(model)
    basis, weakest = _null(stack.reshape(-1, model.nx), tolerance)
    rank = model.nx - basis.shape[1]
    mending = repairs(
        model, candidates, basis, lambda m: _null(rows(m)[0].reshape(-1, m.nx), tolerance)[0]
    )
    return Observability(
        model=model.name,
        states=tuple(s.name for s in model.states),
        rank=rank,
        samples=_samples(stack, rank, tolerance),
        weakest=weakest,
        tolerance=tolerance,
        hidden=combinations(basis, model.states, size),
        lasting=(),
        repairs=mending,
        window=len(u),
    )


def _pushes(model: Model, walks: Mapping[str, float], samples: int) -> Array | None:
    """Random steps of the states that walk, (samples, nx)."""
    if not walks:
        return None
    sigma = np.zeros(model.nx)
    for name, value in walks.items():
        sigma[model.index(name)] = value
    return sigma * np.random.default_rng(0).standard_normal((samples, model.nx))


def unseen(A: Array, C: Array, tolerance: float) -> tuple[Array, int, float]:
    """Basis of the unobservable subspace (nx, d), blocks it took, weakest singular value."""
    length = np.linalg.norm(C, axis=1, keepdims=True)
    rows = C / np.where(length > 0, length, 1.0)
    size = np.linalg.norm(A, 2) or 1.0
    basis, weakest = _null(rows, tolerance)
    blocks = 1
    while basis.shape[1]:
        image = A @ basis / size
        inner, weak = _null(image - basis @ (basis.T @ image), tolerance, largest=1.0)
        if inner.shape[1] == basis.shape[1]:
            break
        basis, weakest, blocks = basis @ inner, min(weakest, weak), blocks + 1
    return basis, blocks, weakest


def _null(rows: Array, tolerance: float, *, largest: float = 0.0) -> tuple[Array, float]:
    """Orthonormal basis of what the rows do not see, and the smallest value that counts."""
    tall = len(rows) > rows.shape[1]
    triangle = np.linalg.qr(rows, mode="r") if tall else rows
    _, values, vectors = np.linalg.svd(triangle, full_matrices=True)
    top = max(largest, values[0] if len(values) else 0.0)
    rank = int((values > tolerance * top).sum())
    return vectors[rank:].T, float(values[rank - 1] / top) if rank else 1.0


def _samples(stack: Array, rank: int, tolerance: float) -> int:
    """Smallest number of first samples that have the rank of all."""
    low, high = 1, len(stack)
    while low < high:
        middle = (low + high) // 2
        basis, _ = _null(stack[:middle].reshape(-1, stack.shape[2]), tolerance)
        low, high = (low, middle) if stack.shape[2] - basis.shape[1] >= rank else (middle + 1, high)
    return low


def lasting_modes(
    A: Array, basis: Array, size: Array, model: Model
) -> tuple[tuple[complex, str], ...]:
    """Modes of the unobservable subspace that do not decay, of a pair the upper one."""
    if not basis.shape[1]:
        return ()
    values, vectors = (np.asarray(v, complex) for v in np.linalg.eig(basis.T @ A @ basis))
    edge = LINEAR_TOLERANCE * (float(np.linalg.norm(A, 2)) if model.continuous else 1.0)
    growth = np.real(values) if model.continuous else np.abs(values) - 1.0
    found = []
    for value, vector, rate in zip(values, (basis @ vectors).T, growth, strict=True):
        if rate >= -edge and value.imag >= 0:
            parts = [vector.real, vector.imag] if value.imag else [vector.real]
            found.append(
                (
                    complex(value),
                    " with ".join(direction_in_words(v, model.states, size) for v in parts),
                )
            )
    return tuple(found)
