"""Structures from the matrices of a finite-element model, reduced to their first modes."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from backsight.description import checked
from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.structures.matrices._around import Around, ReducedKind
from backsight.models.structures.matrices._given import MatrixLike, matrices
from backsight.models.structures.matrices._motion import Equations, motions, moving
from backsight.models.structures.matrices._places import Place, Places
from backsight.models.structures.matrices._skew import skew_model
from backsight.models.structures.matrices._symmetric import Residual, symmetric_model
from backsight.models.views.virtual import built_with_virtual
from backsight.types import Array


@checked(ModelError, only=("residual",))
def reduced(
    mass: MatrixLike,
    stiffness: MatrixLike,
    *,
    modes: int,
    sensors: Mapping[str, tuple[ReducedKind, Place]],
    forces: Mapping[str, Place] | None = None,
    inputs: Mapping[str, Place] | None = None,
    ground: Mapping[str, Place] | None = None,
    virtual: Mapping[str, tuple[ReducedKind, Place]] | None = None,
    fixed: Sequence[int | str] = (),
    constraints: Equations | None = None,
    damping: ArrayLike | None = None,
    rayleigh: tuple[float, float] | None = None,
    loss_factor: float | None = None,
    damping_matrix: MatrixLike | None = None,
    residual: Residual = "none",
    coordinates: Sequence[str] | None = None,
    length_unit: str = "m",
    force_unit: str = "N",
    name: str = "structure",
) -> Model:
    r"""Build a structure from its mass and stiffness matrices and keep the first modes.

    :math:`K \Phi = M \Phi\, \mathrm{diag}(\omega^2)`, :math:`\Phi' M \Phi = I`; the states are the
    modal coordinates :math:`q` of :math:`w = \Phi q` and their rates. Where K or the damping matrix
    is not symmetric (rotors, bearings, condensed matrices), it is said by how much and where, and
    complex modes in real blocks are kept instead: states ``z1_re, z1_im, ...``.

    Parameters
    ----------
    mass, stiffness : (n, n) array, sparse matrix or Matrix
        Mass positive semidefinite, stiffness positive semidefinite. Sparse matrices stay sparse;
        one triangle is completed; a row of masses is a diagonal. Coordinates without mass follow
        the others statically. A `Matrix` (from `read_matrix`) names its coordinates; those of the
        same name belong together.
    modes : int
        Number of modes kept, those of the lowest frequencies (complex modes: of pairs).
    sensors : dict
        Name of the output to ``(kind, place)``: "displacement", "velocity", "acceleration" or
        "strain" at a place: number (from 0 on) or name of a coordinate, ``{coordinate: weight}``,
        or a weight for each coordinate. With `ground` an acceleration is "absolute_acceleration",
        what an accelerometer measures, or "relative_acceleration"; displacements are relative.
    forces, inputs : dict, optional
        Name to place of the forces that are unknown and of those that are measured.
    ground : dict, optional
        Name of a measured acceleration of the ground [length/s2] to the motion of the fixed
        coordinates: a place, or the name of a direction, "UX", for all of them; of a structure
        without its supports, the motion of all coordinates as a rigid body. Several for supports
        that move differently.
    virtual : dict, optional
        What is wanted where no sensor is, described like `sensors`; see `with_virtual`.
    fixed : sequence of int or str
        Coordinates that do not move (relative to the ground).
    constraints : (k, n) array, sparse matrix or list of dict, optional
        C of the multi-point constraints C w = 0; or ``{coordinate: factor}`` for each.
    damping : number or (modes,) array
        Ratio to critical damping. At least one kind of damping is needed; all that are given add
        up, but ratios go with a damping matrix only if that is gyroscopic.
    rayleigh : (float, float)
        :math:`\alpha, \beta` of :math:`C = \alpha M + \beta K` [1/s, s].
    loss_factor : float
        :math:`\eta` of structural damping, :math:`(1 + i \eta) K`: the ratio :math:`\eta / 2`,
        which is the same at each resonance.
    damping_matrix : (n, n) array, sparse matrix or Matrix
        C; its modal form may couple the modes. A skew part is gyroscopic.
    residual : {"none", "modes", "feedthrough"}
        What is done about the static deflection of the modes that are left out. "modes" adds one
        for each force, of a high frequency, so that the model answers statically right to each;
        "feedthrough" adds it to displacements and strains at once, and no states.
    coordinates : sequence of str, optional
        Names of the coordinates, if the matrices have none.
    length_unit, force_unit : str
        For labels. Any consistent set of units will do.
    name : str
        Shown in results.

    Returns
    -------
    Model
        Of kind `modal`, or with complex modes.

    Raises
    ------
    ModelError
        If a matrix has the wrong size, the mass is not symmetric, a matrix is not definite by more
        than rounding, there are more modes than coordinates, or a place is not in the structure.

    Warns
    -----
    BacksightWarning
        If a triangle was completed, coordinates have no mass, a matrix is not symmetric, or modes
        are rigid bodies only by the rounding of a file.

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
    whole = matrices(mass, stiffness, damping_matrix)
    places = Places(whole.n, tuple(coordinates or whole.coordinates))
    if all(kind is None for kind in (damping, rayleigh, loss_factor, damping_matrix)):
        raise ModelError(
            "give either damping, the ratios, or damping_matrix; or rayleigh or loss_factor"
        )
    if damping is not None and damping_matrix is not None and not whole.gyroscopic:
        raise ModelError(
            "give either damping, the ratios, or damping_matrix; both only where the matrix is "
            "gyroscopic, not symmetric"
        )
    allowed = motions(places, fixed, constraints)
    structure = moving(whole, places, allowed, rayleigh or (0.0, 0.0))
    n = structure.n
    if not isinstance(modes, int | np.integer) or not 1 <= modes <= n:
        raise ModelError(f"modes is {modes}; with {n} coordinates it must be from 1 to {n}")
    build = skew_model if whole.skew else symmetric_model

    def seeing(sensors: Mapping[str, tuple[ReducedKind, Place]]) -> Model:
        return build(
            structure,
            Around.read(places, sensors, forces or {}, inputs or {}, ground or {}),
            int(modes),
            ratios=_ratios(damping, loss_factor, int(modes)),
            residual=residual,
            units=(length_unit, force_unit),
            name=name,
        )

    return built_with_virtual(seeing, sensors, virtual) if virtual else seeing(sensors)


def _ratios(damping: ArrayLike | None, loss_factor: float | None, modes: int) -> Array:
    """Ratios to critical damping, (modes,); structural damping has half the loss factor."""
    try:
        given = np.asarray(0.0 if damping is None else damping, float)
    except (TypeError, ValueError):
        raise ModelError(f"damping must be numbers, not {damping!r}") from None
    if given.shape not in ((), (modes,)):
        raise ModelError(
            f"damping has the size {given.shape}; give one number, or {modes}, one per mode"
        )
    ratios = given + (loss_factor or 0.0) / 2
    for i in np.flatnonzero(~((ratios >= 0) & (ratios < 1)).reshape(-1)):
        raise ModelError(
            f"the damping ratio of mode {i + 1} is {ratios.reshape(-1)[i]:g}; it must be from 0 "
            "to below 1"
        )
    return np.broadcast_to(ratios, (modes,))
