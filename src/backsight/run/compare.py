"""Run several estimators over the same recording."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping

import xarray as xr

from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimate import estimate


@dataclasses.dataclass(frozen=True)
class Comparison(Mapping[str, xr.Dataset]):
    """Results by name; prints itself as a ranked table.

    Parameters
    ----------
    results : dict
        Name to result dataset.
    """

    results: Mapping[str, xr.Dataset]

    def __getitem__(self, name: str) -> xr.Dataset:
        return self.results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)


def compare(
    estimators: Mapping[str, AbstractEstimator],
    model: Model,
    recording: xr.Dataset,
    *,
    throw: bool = True,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Comparison:
    """Run estimators over the same recording and rank them.

    Parameters
    ----------
    estimators : dict
        Name (free to choose) to estimator.
    model, recording, throw
        As in `estimate`.
    progress : callable
        Told the name of the estimator at work and the number of samples done.

    Returns
    -------
    Comparison
        A mapping from name to result.
    """
    if not estimators:
        raise TuningError("there is no estimator to compare")
    results = {}
    for name, estimator in estimators.items():
        results[name] = estimate(
            estimator, model, recording, throw=throw, progress=lambda k, n=name: progress(n, k)
        )
    return Comparison(results)
