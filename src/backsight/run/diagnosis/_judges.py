"""Kalman filters that other estimators are held against, each run over a recording once."""

from collections.abc import Mapping

import xarray as xr

from backsight.analysis.comparison import failed
from backsight.description import alike
from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import estimate


class Judges:
    """Results of filters over one recording, made when they are asked for first.

    Parameters
    ----------
    model : Model
    recording : xarray.Dataset
    results, estimators : dict
        What was run over it already: a filter among them need not run again.
    """

    def __init__(
        self,
        model: Model,
        recording: xr.Dataset,
        results: Mapping[str, xr.Dataset],
        estimators: Mapping[str, AbstractEstimator],
    ) -> None:
        self.model, self.recording = model, recording
        self._known: list[tuple[AbstractEstimator, xr.Dataset | None]] = [
            (estimator, results[name])
            for name, estimator in estimators.items()
            if not failed(results[name])
        ]

    def result(self, judge: AbstractEstimator) -> xr.Dataset | None:
        """Result of a filter, None if it fails; kept."""
        for known, result in self._known:
            if alike(known, judge):
                return result
        found = self.trial(judge)
        self._known.append((judge, found))
        return found

    def trial(self, judge: AbstractEstimator) -> xr.Dataset | None:
        """The same of a filter that nobody will ask for again."""
        try:
            return estimate(judge, self.model, self.recording)
        except BacksightError:
            return None
