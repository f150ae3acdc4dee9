"""States of a model that a noise of their own drives."""

import dataclasses
from typing import TYPE_CHECKING

from backsight.types import Array

if TYPE_CHECKING:
    from backsight.models.forces.processes import Process


@dataclasses.dataclass(frozen=True, eq=False)
class Driven:
    """States that are driven by a noise of their own: part of the model, not of an estimator.

    Parameters
    ----------
    states : tuple of str
        Names.
    noise : (n, n) array
        Spectral density of the noise; of a discrete-time model its covariance per sample.
    stationary : (n, n) array
        Covariance of the states before anything is measured.
    says : str
        What they are, in words.
    process : Process, optional
        Of the force that is the first of them, as `augment` was told it.
    mean : float
        Around which it varies.
    """

    states: tuple[str, ...]
    noise: Array
    stationary: Array
    says: str
    process: "Process | None" = None
    mean: float = 0.0
