"""What is kept of an estimation to go on with it later."""

import dataclasses
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.engine.recursion import Recursion
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """The memory of an estimator, and the samples around it that are not settled.

    Parameters
    ----------
    slot : int
        Of the next sample.
    carry : (nc,) array
        The memory before it.
    waiting, waiting_inputs : (l, nu + ny) and (l, nu) arrays
        Samples before it of which an estimator that looks back has yet to say something.
    coming : (n, nu + ny) array
        The sample and those after it, as far as they are known.
    before : (nu,) array
        Inputs before the first of these samples.
    begun : bool
        Whether all inputs have been known.
    largest : (ny,) array
        Largest size of every output so far.
    first_estimate : int
        Slot of the first sample of which no estimate has been taken.
    """

    slot: int
    carry: Array
    waiting: Array
    waiting_inputs: Array
    coming: Array
    before: Array
    begun: bool
    largest: Array
    first_estimate: int

    @classmethod
    def fresh(cls, recursion: Recursion, model: Model) -> "Checkpoint":
        """Before the first sample."""
        width = model.nu + model.ny
        return cls(
            slot=0,
            carry=np.array(recursion.carry0, float),
            waiting=np.empty((0, width)),
            waiting_inputs=np.empty((0, model.nu)),
            coming=np.empty((0, width)),
            before=np.full(model.nu, np.nan),
            begun=False,
            largest=np.zeros(model.ny),
            first_estimate=0,
        )

    def packed(self, **others: float | str | Array) -> bytes:
        """As bytes, with other things to be kept."""
        file = io.BytesIO()
        arrays: dict[str, Any] = {n: np.asarray(v) for n, v in (vars(self) | others).items()}
        np.savez(file, **arrays)  # measured numbers hardly become shorter
        return file.getvalue()

    @classmethod
    def unpacked(cls, content: bytes) -> tuple["Checkpoint", Mapping[str, np.ndarray]]:
        """The memory, and the other things, by name."""
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            found = dict(file)
        own = {f.name: found.pop(f.name) for f in dataclasses.fields(cls)}
        for name in ("slot", "first_estimate"):
            own[name] = int(own[name])
        own["begun"] = bool(own["begun"])
        return cls(**own), found


def filled_forward(rows: Array, before: Array) -> Array:
    """LiveRows (n, m) in which NaN is the value of the row before; of the first one, `before`."""
    if not np.isnan(rows).any():
        return rows.copy()
    n = len(rows)
    joined = np.vstack([before, rows])
    known = np.where(np.isnan(joined), 0, np.arange(n + 1)[:, None])
    return np.take_along_axis(joined, np.maximum.accumulate(known, axis=0), axis=0)[1:]
