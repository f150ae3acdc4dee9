"""What is handed on from one part of a recording to the next."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from backsight.engine.recursion import Recursion
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import Outputs, Prepared
from backsight.run.parts._pace import Pace
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class PartsRun:
    """What stays the same from part to part."""

    estimator: AbstractEstimator
    model: Model
    compiled: Prepared
    outputs: Outputs
    pace: Pace


@dataclasses.dataclass(frozen=True)
class State:
    """All that is handed on from one part to the next.

    Parameters
    ----------
    parts, samples : int
        Done so far.
    carry : (nc,) array
        Memory of the estimator and its totals.
    missed : int
        Status bits since the last sample that was kept.
    time, u, y : arrays
        Of the last samples, about which an estimator that looks back has yet to say something.
    u_sum : (nu,) array
        Sum of the inputs.
    end : float
        Time of the last sample.
    stamps : array of str
        By which the files of the parts that are done are known again.
    """

    parts: int
    samples: int
    carry: Array
    missed: int
    time: Array
    u: Array
    y: Array
    u_sum: Array
    end: float
    stamps: np.ndarray

    @classmethod
    def begin(cls, recursion: Recursion, run: PartsRun) -> "State":
        """Before the first sample."""
        nu, ny = run.model.nu, run.model.ny
        return cls(
            parts=0,
            samples=0,
            carry=recursion.carry0,
            missed=0,
            time=np.empty(0),
            u=np.empty((0, nu)),
            y=np.empty((0, ny)),
            u_sum=np.zeros(nu),
            end=np.nan,
            stamps=np.empty((0, 3), "U1"),
        )

    @classmethod
    def of(cls, kept: Mapping[str, np.ndarray]) -> "State":
        """What `kept` was made from."""
        return cls(
            parts=int(kept["parts"]),
            samples=int(kept["samples"]),
            carry=kept["carry"],
            missed=int(kept["missed"]),
            time=kept["time"],
            u=kept["u"],
            y=kept["y"],
            u_sum=kept["u_sum"],
            end=float(kept["end"]),
            stamps=kept["stamps"],
        )

    def kept(self) -> dict[str, np.ndarray]:
        """As arrays, to be written."""
        return {f.name: np.asarray(getattr(self, f.name)) for f in dataclasses.fields(self)}
