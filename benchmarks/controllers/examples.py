"""Estimators of the examples with their recordings."""

import dataclasses
import functools
from pathlib import Path

import xarray as xr

from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.problem import load
from backsight.problem.recorded import recording_of

EXAMPLES = Path(__file__).parents[2] / "examples"

NAMES = ("beam", "bridge", "frame", "motor", "quarter_car", "rotor", "stage", "storeys")


@dataclasses.dataclass(frozen=True)
class Example:
    """A model with estimators and a recording.

    Parameters
    ----------
    name : str
    model : Model
    recording : xarray.Dataset
    estimators : dict
    """

    name: str
    model: Model
    recording: xr.Dataset
    estimators: dict[str, AbstractEstimator]


@functools.cache
def example(name: str) -> Example:
    """Read an example."""
    problem = load(EXAMPLES / name / "problem.toml")
    return Example(name, problem.model, recording_of(problem), dict(problem.estimators))
