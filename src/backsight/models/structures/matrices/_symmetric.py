"""Symmetric structures: real modes, and what stands for the modes that are left out."""

from typing import Literal, TypeAlias

import numpy as np

from backsight.models.model import Model
from backsight.models.structures.matrices._around import Around, feedthrough, with_ground
from backsight.models.structures.matrices._motion import Moving, ground_shape
from backsight.models.structures.matrices._places import deflection
from backsight.models.structures.matrices._statics import residual as residual_of
from backsight.models.structures.matrices._statics import residual_modes, static
from backsight.models.structures.matrices.lowest_modes import lowest
from backsight.models.structures.modal import modal
from backsight.types import Array

Residual: TypeAlias = Literal["none", "modes", "feedthrough"]
"""What is done about the modes that are left out."""


def symmetric_model(
    structure: Moving,
    around: Around,
    modes: int,
    *,
    ratios: Array,
    residual: Residual,
    units: tuple[str, str],
    name: str,
) -> Model:
    """Build the model of the first real modes; see `reduced`."""
    M, K, T = structure.mass, structure.stiffness, structure.motions.T
    found = lowest(M, K, modes, precision=structure.whole.precision)
    squares, shapes = found.squares, found.shapes
    loads = T.T @ around.loads().toarray()
    left = np.zeros_like(loads) if residual == "none" else residual_of(M, found, loads)
    if residual == "modes":
        more, V = residual_modes(M, K, left)
        left = left - V @ ((V.T @ loads) / more[:, None])
        squares, shapes = np.append(squares, more), np.hstack([shapes, V])
        ratios = np.append(ratios, np.full(more.size, ratios.max()))
    omega, Phi = np.sqrt(squares), T @ shapes
    damping = ratios
    if structure.damping.nnz:
        damping = np.diag(2 * ratios * omega) + shapes.T @ (structure.damping @ shapes)
    mass = structure.whole.mass.diagonal()
    moved = {
        k: ground_shape(structure, at, lambda pull: static(M, found, pull))
        for k, at in around.ground.items()
    }
    pushed = {k: -(Phi.T @ (structure.whole.mass @ iota)) for k, iota in moved.items()}
    made = modal(
        omega / (2 * np.pi),
        damping=damping,
        sensors={k: (s.kind, deflection(s.weights, Phi, mass)) for k, s in around.sensors.items()},
        forces={k: deflection(at, Phi, mass) for k, at in around.forces.items()},
        inputs={k: deflection(at, Phi, mass) for k, at in around.inputs.items()} | pushed,
        feedthrough=feedthrough(around, T @ left, moved),
        length_unit=units[0],
        force_unit=units[1],
        name=name,
    )
    return with_ground(made, around, units[0])
