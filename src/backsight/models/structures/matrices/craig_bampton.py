r"""Substructures by the method of Craig and Bampton: boundary coordinates stay what they are.

.. math::
    w = \begin{bmatrix} I & 0 \\ \Psi & \Phi \end{bmatrix} \begin{bmatrix} w_b \\ q \end{bmatrix},
    \qquad \Psi = -K_{ii}^{-1} K_{ib}, \quad K_{ii} \Phi = M_{ii} \Phi \Lambda \qquad (1)

Source: Craig, Bampton, "Coupling of substructures for dynamic analyses", AIAA Journal 6(7), 1968,
doi:10.2514/3.4741.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy

from backsight.errors import ModelError
from backsight.models.structures.matrices._given import MatrixLike, matrices
from backsight.models.structures.matrices._motion import Equations, Moving, motions, moving
from backsight.models.structures.matrices._places import Place, Places
from backsight.models.structures.matrices._statics import static
from backsight.models.structures.matrices.lowest_modes import lowest
from backsight.types import Array, Indices


@dataclasses.dataclass(frozen=True)
class Substructure:
    """A structure on its boundary coordinates and its modes with the boundary fixed.

    `second_order` takes the matrices; springs, dampers, parameters and other substructures are
    added at the boundary.

    Parameters
    ----------
    mass, damping, stiffness : (b + m, b + m) array
        Boundary first, then modes.
    coordinates : tuple of str
        Names for `second_order`: ``"b1"``... of the boundary, then ``"q1"``... of the modes.
    basis : (n, b + m) array
        Takes them to all coordinates.
    places : Places
        Finds coordinates.
    """

    mass: Array
    damping: Array
    stiffness: Array
    coordinates: tuple[str, ...]
    basis: Array
    places: Places

    def at(self, place: Place) -> Array:
        """Weights of the coordinates of the substructure for a place on it, (b + m,).

        They are the direction of a force there, and what a sensor there sees.
        """
        return (self.places.weights(place, "the place").T @ self.basis).ravel()


def craig_bampton(
    mass: MatrixLike,
    stiffness: MatrixLike,
    *,
    boundary: Sequence[int | str],
    modes: int,
    fixed: Sequence[int | str] = (),
    constraints: Equations | None = None,
    rayleigh: tuple[float, float] | None = None,
    damping_matrix: MatrixLike | None = None,
    coordinates: Sequence[str] | None = None,
) -> Substructure:
    """Reduce a structure to boundary coordinates and modes with the boundary fixed (eq. 1).

    Exact statically for forces at the boundary, and for what is attached there.

    Parameters
    ----------
    mass, stiffness : (n, n) array, sparse matrix or Matrix
        Symmetric, as in `reduced`.
    boundary : sequence of int or str
        Coordinates that stay: where springs of unknown stiffness, other structures or nonlinear
        parts are attached.
    modes : int
        Number of modes of the interior, those of the lowest frequencies; 0 is Guyan's condensation.
    fixed, constraints, rayleigh, damping_matrix, coordinates
        As in `reduced`.

    Raises
    ------
    ModelError
        As in `reduced`; if a boundary coordinate is fixed or depends on others by a constraint; if
        the interior can move while the boundary is fixed.

    Examples
    --------
    A chain whose last mass rests on a spring that is not known:

    >>> import numpy as np
    >>> from backsight.models.structures import second_order
    >>> chain = 1e3 * (2 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1))
    >>> part = craig_bampton(np.eye(6), chain, boundary=[5], modes=2, rayleigh=(0.1, 1e-4))
    >>> K = part.stiffness.astype(object)
    >>> K[0, 0] = f"{K[0, 0]} + k"
    >>> model = second_order(
    ...     part.mass, part.damping, K, forces={"F": part.at(2)}, inputs={"F": "N"},
    ...     parameters={"k": 50.0}, outputs={"y": ("displacement", part.at(0))},
    ... )
    """
    whole = matrices(mass, stiffness, damping_matrix)
    if whole.skew:
        raise ModelError(f"{'; '.join(whole.skew.values())}: substructures need symmetric matrices")
    places = Places(whole.n, tuple(coordinates or whole.coordinates))
    numbers = [places.number(name, "boundary") for name in boundary]
    structure = moving(whole, places, motions(places, fixed, constraints), rayleigh or (0.0, 0.0))
    b = _columns(structure, numbers, places)
    basis = _basis(structure, b, modes)
    M, C, K = (
        _symmetric(basis.T @ (A @ basis))
        for A in (structure.mass, structure.damping, structure.stiffness)
    )
    names = [f"b{k + 1}" for k in range(b.size)]
    return Substructure(
        mass=M,
        damping=C,
        stiffness=K,
        coordinates=(*names, *(f"q{i + 1}" for i in range(modes))),
        basis=structure.motions.T @ basis,
        places=places,
    )


def _columns(structure: Moving, numbers: Sequence[int], places: Places) -> Indices:
    free = {int(i): k for k, i in enumerate(structure.motions.free)}
    for i in numbers:
        if i not in free:
            name = places.names[i] if places.names else i
            raise ModelError(
                f"the boundary coordinate {name} is fixed, or follows from the others by a "
                "constraint; name another"
            )
    if len(set(numbers)) < len(numbers) or not numbers:
        raise ModelError("the boundary needs at least one coordinate, each named once")
    return np.array([free[i] for i in numbers])


def _basis(structure: Moving, b: Indices, modes: int) -> Array:
    """(1), the rows in the order of the coordinates that move."""
    M, K = structure.mass, structure.stiffness
    inside = np.setdiff1d(np.arange(structure.n), b)
    if not isinstance(modes, int | np.integer) or not 0 <= modes <= inside.size:
        raise ModelError(f"modes is {modes}; inside there are {inside.size}")
    basis = np.zeros((structure.n, b.size + int(modes)))
    basis[b, np.arange(b.size)] = 1.0
    if not inside.size:
        return basis
    Mii, Kii = (scipy.sparse.csc_array(A[inside][:, inside]) for A in (M, K))
    found = lowest(Mii, Kii, max(int(modes), 1), precision=structure.whole.precision)
    if not found.squares.all():
        raise ModelError("the interior can move while the boundary is fixed; add to the boundary")
    basis[inside, : b.size] = static(Mii, found, -K[inside][:, b].toarray())
    basis[inside, b.size :] = found.shapes[:, : int(modes)]
    return basis


def _symmetric(A: Array) -> Array:
    return (A + A.T) / 2
