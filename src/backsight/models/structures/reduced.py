"""Structures from the matrices of a finite-element model, reduced to their first modes."""

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.structures.modal import SensorKind, modal
from backsight.types import Array

RIGID = 1e-9
"""A squared frequency below this share of the largest of the matrices is that of a rigid body."""

Place = int | ArrayLike
"""Number of a coordinate, from 0 on, or a weight for each of them."""


def reduced(
    mass: ArrayLike,
    stiffness: ArrayLike,
    *,
    modes: int,
    sensors: Mapping[str, tuple[SensorKind, Place]],
    forces: Mapping[str, Place] | None = None,
    inputs: Mapping[str, Place] | None = None,
    virtual: Mapping[str, tuple[SensorKind, Place]] | None = None,
    damping: ArrayLike | None = None,
    damping_matrix: ArrayLike | None = None,
    length_unit: str = "m",
    force_unit: str = "N",
    name: str = "structure",
) -> Model:
    r"""Build a structure from its mass and stiffness matrices and keep the first modes.

    :math:`K \Phi = M \Phi\, \mathrm{diag}(\omega^2)`, :math:`\Phi' M \Phi = I`; the states are the
    modal coordinates :math:`q` of :math:`w = \Phi q` and their rates.

    Parameters
    ----------
    mass, stiffness : (n, n) array
        Symmetric; mass positive definite, stiffness positive semidefinite.
    modes : int
        Number of modes kept, those of the lowest frequencies.
    sensors : dict
        Name of the output to ``(kind, place)``: "displacement", "velocity", "acceleration" or
        "strain" with the number of a coordinate (from 0 on) or a weight for each coordinate.
    forces, inputs : dict, optional
        Name to place of the forces that are unknown and of those that are measured.
    virtual : dict, optional
        What is wanted where no sensor is, described like `sensors`; see `with_virtual`.
    damping : number or (modes,) array
        Ratio to critical damping. Or give `damping_matrix`.
    damping_matrix : (n, n) array
        C; its modal form may couple the modes.
    length_unit, force_unit, name
        As in `modal`.

    Raises
    ------
    ModelError
        If a matrix has the wrong size, is not symmetric or not definite, there are more modes than
        coordinates, or a place is not in the structure.

    Examples
    --------
    Four equal masses between two walls, two modes, an unknown force at the second mass:

    >>> import numpy as np
    >>> chain = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    >>> row = reduced(
    ...     np.eye(4), 1e3 * chain, modes=2, damping=0.01,
    ...     sensors={"y": ("displacement", 0)}, forces={"F": 1},
    ... )
    >>> print(row)
    structure (continuous)
    ├── states      q1, q2, q1_dot, q2_dot
    ├── outputs     y [m]
    └── parameters  F = 0
    """
    M, K = _symmetric(mass, "mass"), _symmetric(stiffness, "stiffness")
    n = len(M)
    if K.shape != M.shape:
        raise ModelError(f"stiffness has the shape {K.shape}, but mass {M.shape}")
    if not isinstance(modes, int | np.integer) or not 1 <= modes <= n:
        raise ModelError(f"modes is {modes}; with {n} coordinates it must be from 1 to {n}")
    if (damping is None) == (damping_matrix is None):
        raise ModelError("give either damping, the ratios, or damping_matrix")
    try:
        squares, Phi = scipy.linalg.eigh(K, M, subset_by_index=[0, int(modes) - 1])
    except np.linalg.LinAlgError:
        raise ModelError("mass is not positive definite; every coordinate needs a mass") from None
    edge = RIGID * np.max(K.diagonal() / M.diagonal())
    if squares[0] < -edge:
        raise ModelError(
            f"stiffness is not positive semidefinite: a squared frequency is {squares[0]:.3g}"
        )
    omega = np.sqrt(np.where(squares > edge, squares, 0.0))
    ratios = damping
    if ratios is None:
        C = _symmetric([] if damping_matrix is None else damping_matrix, "damping_matrix")
        if C.shape != M.shape:
            raise ModelError(f"damping_matrix has the shape {C.shape}, but mass {M.shape}")
        ratios = Phi.T @ C @ Phi
    return modal(
        omega / (2 * np.pi),
        damping=ratios,
        sensors={k: (kind, _at(Phi, at, f"sensor '{k}'")) for k, (kind, at) in sensors.items()},
        virtual={
            k: (kind, _at(Phi, at, f"virtual '{k}'")) for k, (kind, at) in (virtual or {}).items()
        },
        forces={k: _at(Phi, at, f"force '{k}'") for k, at in (forces or {}).items()},
        inputs={k: _at(Phi, at, f"input '{k}'") for k, at in (inputs or {}).items()},
        length_unit=length_unit,
        force_unit=force_unit,
        name=name,
    )


def _at(Phi: Array, place: Place, what: str) -> Array:
    """Shapes (modes,) at a coordinate or under weights; rounding errors of a node are zero."""
    n = len(Phi)
    if isinstance(place, int | np.integer):
        if not 0 <= place < n:
            raise ModelError(f"{what} is at coordinate {place}; there are 0 to {n - 1}")
        weights = np.eye(n)[place]
    else:
        try:
            weights = np.asarray(place, float)
        except (TypeError, ValueError):
            raise ModelError(f"{what} is neither a coordinate nor a list of weights") from None
    if weights.shape != (n,):
        raise ModelError(f"{what} has {weights.shape} weights; {n} coordinates need ({n},)")
    row = weights @ Phi
    return np.where(np.abs(row) > RIGID * (np.abs(weights) @ np.abs(Phi)), row, 0.0)


def _symmetric(given: ArrayLike, what: str) -> Array:
    try:
        A = np.asarray(given, float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} is not a matrix of numbers") from None
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not A.size:
        raise ModelError(f"{what} has the shape {A.shape}; it must be square")
    if not np.isfinite(A).all():
        raise ModelError(f"{what} has an entry that is not finite")
    if np.abs(A - A.T).max() > 1e-9 * np.abs(A).max():
        raise ModelError(f"{what} is not symmetric")
    return (A + A.T) / 2
