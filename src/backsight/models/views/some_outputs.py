"""A model with some of its outputs."""

import dataclasses
from collections.abc import Sequence

import casadi as ca

from backsight.errors import ModelError, nearest
from backsight.models.model import Model


def some_outputs(model: Model, names: Sequence[str]) -> Model:
    """Keep the named outputs, in this order; raises `ModelError` on names that it has not."""
    known = [s.name for s in model.outputs]
    for name in names:
        if name not in known:
            raise ModelError(f"the model has no output '{name}': {nearest(name, known)}")
    chosen = [known.index(name) for name in names]
    given = [ca.SX.sym(model.h.name_in(i), *model.h.size_in(i)) for i in range(model.h.n_in())]
    (rows,) = model.h.call(given)
    return dataclasses.replace(
        model,
        h=ca.Function("h", given, [rows[chosen]]),
        outputs=tuple(model.outputs[i] for i in chosen),
    )
