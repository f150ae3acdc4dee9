"""Unknown forces as inputs, for the methods that treat them so."""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models._affine import by_parameters, remember, remembered
from backsight.models.model import Model
from backsight.models.signals import along


@checked(ModelError)
def forces_as_inputs(model: Model, forces: Sequence[str]) -> Model:
    r"""Move parameters that are unknown forces to the end of the inputs.

    With :math:`\dot x = f(x, u, p)` linear, the last columns of its matrices (`state_space`) are
    then those of the forces: what `augment` does for the states, this does for the inputs.

    Parameters
    ----------
    model : Model
        Every unknown force is a parameter of it, with the value 0.
    forces : sequence of str
        Names, in the order of the new inputs.

    Raises
    ------
    ModelError
        If no force is named, one is named twice, or the model has no such parameter.

    Examples
    --------
    >>> [
    ...     s.name
    ...     for s in bs.forces.forces_as_inputs(
    ...         bs.models.beam(
    ...             length=1.0,
    ...             width=0.02,
    ...             thickness=5e-3,
    ...             youngs_modulus=7e10,
    ...             density=2700.0,
    ...             modes=1,
    ...             sensors={"tip": ("displacement", 1.0)},
    ...             forces={"hit": 0.7},
    ...         ),
    ...         ["hit"],
    ...     ).inputs
    ... ]
    ['hit']
    """
    known = {s.name: s for s in model.parameters}
    if not forces:
        raise ModelError(f"no unknown force is named; the model has {', '.join(known) or 'none'}")
    for name in forces:
        if name not in known:
            raise ModelError(f"the model has no parameter '{name}': {nearest(name, known)}")
    twice = [n for i, n in enumerate(forces) if n in forces[:i]]
    if twice:
        raise ModelError(f"the force '{twice[0]}' is named twice")
    kept = [s for s in model.parameters if s.name not in forces]
    x, p = ca.SX.sym("x", model.nx), ca.SX.sym("p", len(kept))
    u = ca.SX.sym("u", model.nu + len(forces))
    symbols = {n: u[model.nu + i] for i, n in enumerate(forces)}
    symbols |= {s.name: p[i] for i, s in enumerate(kept)}
    full = ca.vertcat(*(symbols[s.name] for s in model.parameters))
    given, w = [x, u[: model.nu], full], ca.SX.sym("w", model.nx)
    f = ca.Function("f", [x, u, p], model.f.call(given))
    h = ca.Function("h", [x, u, p], model.h.call(given))
    for new, old in ((f, model.f), (h, model.h)):
        _remember_forces(new, old, model, forces)
    return dataclasses.replace(
        model,
        f=f,
        h=h,
        inputs=(*model.inputs, *(known[n] for n in forces)),
        parameters=tuple(kept),
        unsolved=model.unsolved_at([x, u, p], given),
        virtual=along(model.virtual, [x, u, p, w], [*given, w]),
    )


def _remember_forces(
    new: ca.Function, old: ca.Function, model: Model, forces: Sequence[str]
) -> None:
    """What is known of an equation is known of that with forces as inputs, whose value is 0."""
    known, by_p = remembered(old, model.theta), by_parameters(old, model.theta)
    if known is None or by_p is None:
        return
    names = [s.name for s in model.parameters]
    moved = [names.index(name) for name in forces]
    kept = [k for k in range(len(names)) if k not in moved]
    by_x, by_u, constants = known
    rest = constants - by_p[:, moved] @ model.theta[moved]
    affine = by_x, np.hstack([by_u, by_p[:, moved]]), rest
    remember(new, model.theta[kept], affine, by_p[:, kept])
