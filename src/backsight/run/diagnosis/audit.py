"""Put beside results what speaks for or against them: times, units, and the noise assumed."""

from collections.abc import Mapping

import xarray as xr

from backsight.analysis.comparison import ALIGNED, ALIGNMENT
from backsight.analysis.recording import Alignment
from backsight.errors import ModelError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._alignment import check_alignment
from backsight.run.diagnosis._noise_factors import MOST_STATES, with_noise_factors


def audited(
    results: Mapping[str, xr.Dataset],
    estimators: Mapping[str, AbstractEstimator],
    model: Model,
    recording: xr.Dataset,
) -> dict[str, xr.Dataset]:
    """Results with what was found out about the recording and their noise as attributes.

    The verdicts, the report and the summary read it from there. Models with many states are not
    looked at: it would take longer than the estimation itself.
    """
    found = aligned(estimators, model, recording)
    about: dict[str, str | int] = {} if found is None else {ALIGNMENT: str(found)}
    if found is not None and found.aligned is not None:
        about[ALIGNED] = int(found.aligned)
    return {
        name: with_noise_factors(result, estimators[name], model).assign_attrs(about)
        for name, result in results.items()
    }


def aligned(
    estimators: Mapping[str, AbstractEstimator], model: Model, recording: xr.Dataset
) -> Alignment | None:
    """Judge times and units by the first estimator that has a noise and a prior.

    None if the model has no inputs or many states, or no estimator will do.
    """
    if model.nx > MOST_STATES or model.nu == 0:
        return None
    for estimator in estimators.values():
        try:
            return check_alignment(estimator, model, recording)
        except (TuningError, ModelError):
            continue
    return None
