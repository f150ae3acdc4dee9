"""A value that a fit may change, resolved."""

import dataclasses
from typing import Literal

from backsight.tune.fitting.values._matrix import FreeMatrix
from backsight.tune.fitting.values._scale import AbstractScale

Kind = Literal[
    "sigma_y", "R", "walk", "matrix", "sigma_x0", "P0", "x0", "parameter", "process", "setting",
    "delay",
]  # fmt: skip
"""What a value is; ``walk`` is all process noise that is a factor of `sigma_w`, `Q`, `Qc` or of an
entry of them, ``matrix`` a variance or a correlation of a `FreeMatrix`, ``process`` a number of the
process that a force follows (``wind.sigma``)."""


@dataclasses.dataclass(frozen=True)
class Unknown:
    """One value that a fit may change.

    Parameters
    ----------
    name : str
        As the user says it, ``sigma_y.q``.
    kind : Kind
    entry : str
        The signal, the matrix with the state (``Qc.v``), the parameter, or the path of the setting.
    scale : AbstractScale
    spread : float
        Standard deviation of the prior on the scale.
    per : "all", "recording" or tuple of str
        See `Free`.
    unit : str
    matrix : FreeMatrix, optional
        That it is an entry of.
    """

    name: str
    kind: Kind
    entry: str
    scale: AbstractScale
    spread: float
    per: Literal["all", "recording"] | tuple[str, ...]
    unit: str = ""
    matrix: FreeMatrix | None = None

    @property
    def late_output(self) -> bool:
        """Whether it is the delay of one output of several."""
        return self.kind == "delay" and self.entry.startswith("y.")

    @property
    def start(self) -> float:
        """Value before."""
        return self.scale.start
