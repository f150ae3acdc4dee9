"""The numbers of a result by name, and whether they can be believed."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backsight.engine.recursion import Channel
from backsight.models.model import Model
from backsight.run.estimation._match import with_turns
from backsight.schema import WEIGHT, Status
from backsight.types import Array

HUGE = 1e100
"""No quantity of a machine, and no variance, is as large in any unit."""

LIMITS = {
    "x_hat": HUGE,
    "P": HUGE,
    "y_hat": HUGE,
    "S": HUGE,
    "x_std": HUGE**0.5,
    "e_std": HUGE**0.5,
}
"""What variables, where they are there, must stay below."""

TOLD_BY = {"P": "x_std", "S": "e_std"}
"""Covariances, and the deviations that tell of them: what is found does not depend on what is kept.
"""

ABSURD = 1e6
"""An output that is wrong by so many times what was ever measured comes from a diverged filter."""


def named(outputs: Sequence[Array], channels: Sequence[Channel]) -> dict[str, Array]:
    """Outputs of a recursion (n, l) by name, in the shape of their dimensions."""
    return {c.name: c.unpack(o) for c, o in zip(channels, outputs, strict=True)}


def deviation(P: Array) -> Array:
    """Standard deviations (n, m) that belong to covariances (n, m, m)."""
    return np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))


@dataclasses.dataclass(frozen=True)
class Measured:
    """What was measured, and the size of it.

    Parameters
    ----------
    y : (n, ny) array
        NaN where not measured.
    largest : (ny,) array
        Largest size of every output in the whole recording.
    """

    y: Array
    largest: Array

    @classmethod
    def of(cls, y: Array) -> "Measured":
        """Of a whole recording (n, ny)."""
        return cls(y, np.nanmax(np.abs(y), initial=0.0, axis=0))

    def __getitem__(self, part: slice) -> "Measured":
        return Measured(self.y[part], self.largest)


def looked_at(
    values: Mapping[str, Array], measured: Measured, model: Model
) -> dict[str, np.ndarray]:
    """The same with the innovations of what was measured only, and a status that tells failures.

    With ``y``, what was measured; of angles that start anew after a turn with the turns that bring
    them near to their estimates.
    """
    y = with_turns(model, measured.y, values["y_hat"])
    measured = dataclasses.replace(measured, y=y)
    finite = np.isfinite(y)
    seen = {}
    if not finite.all():
        names = [name for name in ("e", WEIGHT) if name in values]
        seen = {name: np.where(finite, values[name], np.nan) for name in names}
    told = values["status"]
    status = (told if np.isfinite(told).all() else np.nan_to_num(told)).astype(np.int32)
    worthless = _worthless(values, measured)
    if worthless.any():
        status[worthless] |= np.int32(Status.NOT_FINITE)
    return {**values, **seen, "y": y, "status": status}


def _worthless(values: Mapping[str, Array], measured: Measured) -> NDArray[np.bool_]:
    """Whether the filter has diverged at a sample, (n,), whatever it says of itself.

    Its numbers are not finite or not those of a machine, or it says something else of what was just
    measured, beyond its own doubts and by far more than anything that was ever measured.
    """
    n = len(measured.y)
    sound = np.ones(n, bool)
    for name, limit in LIMITS.items():
        if name not in values or TOLD_BY.get(name) in values:
            continue
        part = values[name].reshape(n, math.prod(values[name].shape[1:]))
        # Nearly always all of it is, which the sum of the squares tells in one pass without a copy.
        # NaN is not below anything.
        if part.size and not float(np.vdot(part, part)) < limit**2:
            sound &= (np.abs(part) < limit).all(axis=1)
    doubt = measured.largest
    if "e_std" in values or "S" in values:
        told = values["e_std"] if "e_std" in values else deviation(values["S"])
        doubt = np.maximum(np.where(sound[:, None], told, 0.0), doubt)
    off = np.abs(np.where(sound[:, None], values["y_hat"], 0.0) - measured.y)
    with np.errstate(over="ignore"):  # of what is measured; nothing is larger than infinity
        return ~sound | (off > ABSURD * doubt).any(axis=1)
