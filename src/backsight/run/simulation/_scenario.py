"""What happens during a simulation: inputs, jumps and disturbances, checked against the model."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backsight.errors import DataError, ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import vector
from backsight.types import Array

Disturbance: TypeAlias = ArrayLike | Callable[[Array], ArrayLike]
"""One value per sample, held, or a function of an array of times [s]."""

Integers: TypeAlias = NDArray[np.integer]

Push: TypeAlias = Callable[[Integers, Array], Array]
"""``(samples, times) -> values`` of a disturbance, all (k,)."""


def input_columns(model: Model, u: ArrayLike | Mapping[str, ArrayLike]) -> Array:
    """Inputs of all samples, (n, nu); errors as in `simulate`."""
    names = [s.name for s in model.inputs]
    U = _by_name(u, names) if isinstance(u, Mapping) else as_numbers(u, "u")
    if U.ndim == 1 and model.nu == 1:
        U = U[:, None]
    if U.ndim != 2 or U.shape[1] != model.nu:
        raise DataError(
            f"u has the shape {U.shape}; it must be (samples, {model.nu}) for the inputs "
            f"{', '.join(names) or '(none)'}"
        )
    if len(U) == 0:
        raise DataError("u has no samples: there is nothing to simulate")
    if not np.isfinite(U).all():
        k, i = np.argwhere(~np.isfinite(U))[0]
        raise DataError(f"input '{names[i]}' is {U[k, i]} at sample {k}; it must be finite")
    return U


def _by_name(u: Mapping[str, ArrayLike], names: list[str]) -> Array:
    for name in u:
        if name not in names:
            raise ModelError(f"u names '{name}': {nearest(name, names)}")
    missing = [name for name in names if name not in u]
    if missing or not names:
        raise ModelError(f"u has no values for {', '.join(missing) or 'a model without inputs'}")
    columns = {name: as_numbers(u[name], f"input '{name}'") for name in names}
    shapes = {name: c.shape for name, c in columns.items()}
    if len(set(shapes.values())) > 1 or any(c.ndim != 1 for c in columns.values()):
        raise DataError(f"the inputs must be columns of equal length, but have the shapes {shapes}")
    return np.column_stack(list(columns.values()))


@dataclasses.dataclass(frozen=True)
class Steps:
    """Parameters that are constant from one sub-step to another.

    Parameters
    ----------
    begins : (m,) array
        Number of the sub-step from which on a row of `values` holds; the first is 0.
    values : (m, np) array
    """

    begins: Integers
    values: Array

    def at(self, substeps: Integers) -> Array:
        """Values during the given sub-steps, (k, np)."""
        return self.values[np.searchsorted(self.begins, substeps, side="right") - 1]


def parameter_steps(
    model: Model,
    given: Mapping[str, float],
    changes: Mapping[float, Mapping[str, float]],
    *,
    grid: float,
    end: float,
) -> Steps:
    """Values of all parameters over time, on a grid of sub-steps [s], up to `end` [s]."""
    begins = [0]
    rows = [_values(model, given, "parameters", model.theta)]
    for moment, jump in sorted(changes.items()):
        if not 0 <= moment < end:
            raise DataError(f"a change at {moment:g} s lies outside the recording, 0 to {end:g} s")
        begins.append(round(moment / grid))
        rows.append(_values(model, jump, f"the change at {moment:g} s", rows[-1]))
    return Steps(np.array(begins), np.array(rows))


def _values(model: Model, given: Mapping[str, float], what: str, default: Array) -> Array:
    values = vector(given, model.parameters, what=what, default=default)
    if not np.isfinite(values).all():
        raise DataError(f"{what}: every value must be finite, not {dict(given)}")
    return values


def disturbance_of(state: str, given: Disturbance, n: int) -> Push:
    """Read what is added to the derivative of a state.

    Raises
    ------
    DataError
        If there is not one finite value for each of the n samples (or of the times).
    """
    if callable(given):

        def evaluated(_: Integers, times: Array) -> Array:
            values = as_numbers(given(times), f"the disturbance of '{state}'")
            if values.shape not in ((), times.shape):
                raise DataError(
                    f"the disturbance of '{state}' returned the shape {values.shape} for "
                    f"{len(times)} times; write it with functions of NumPy"
                )
            if not np.isfinite(values).all():
                raise DataError(f"the disturbance of '{state}' is not finite at every time")
            return np.broadcast_to(values, times.shape)

        return evaluated

    column = as_numbers(given, f"the disturbance of '{state}'")
    if column.shape != (n,):
        raise DataError(
            f"the disturbance of '{state}' has the shape {column.shape}; give one value for each "
            f"of the {n} samples, or a function of time"
        )
    if not np.isfinite(column).all():
        k = int(np.argmin(np.isfinite(column)))
        raise DataError(f"the disturbance of '{state}' is {column[k]} at sample {k}")
    return lambda samples, _: column[samples]


def as_numbers(given: ArrayLike, what: str) -> Array:
    """Read an array of numbers; raises `DataError` that says what is not one."""
    if np.iscomplexobj(given):
        raise DataError(f"{what} holds complex numbers; give real ones")
    try:
        return np.asarray(given, float)
    except (TypeError, ValueError):
        raise DataError(f"{what} is not an array of numbers") from None
