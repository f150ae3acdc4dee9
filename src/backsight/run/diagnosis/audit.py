"""Put beside results what speaks for or against them: times, units, and the noise assumed."""

import dataclasses
from collections.abc import Mapping

import xarray as xr

from backsight.analysis.alignment import Alignment
from backsight.analysis.comparison import ALIGNED, ALIGNMENT, DOUBTS, failed
from backsight.analysis.consistency import NoiseFactors, check_consistency
from backsight.analysis.observability import Identifiability
from backsight.errors import BacksightError, ModelError, TuningError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._factors_of_results import MOST_STATES, factors_of, with_factors
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis._lone_readings import lone_readings, misled_constants
from backsight.run.diagnosis._readings import clipped_readings, coarse_readings, turned_readings
from backsight.run.diagnosis._walks import Walks
from backsight.run.diagnosis.delays import check_alignment
from backsight.run.diagnosis.parameters.flat import behind_kinks
from backsight.run.diagnosis.parameters.identifiability import check_identifiability
from backsight.run.diagnosis.parameters.sense import surprises


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
    if found is not None and any(map(_consistent, results.values())):
        found = dataclasses.replace(found, explained=found.explained or found.late)
    about: dict[str, str | int] = {} if found is None else {ALIGNMENT: str(found)}
    if found is not None and found.aligned is not None:
        about[ALIGNED] = int(found.aligned)
    judges = Judges(model, recording, results, estimators)
    factors = noise_found(results, estimators, judges)
    doubts = doubts_found(results, estimators, judges)
    return {
        name: with_factors(result, factors[name]).assign_attrs(
            about | ({DOUBTS: "\n".join(doubts[name])} if doubts[name] else {})
        )
        for name, result in results.items()
    }


def _consistent(result: xr.Dataset) -> bool:
    """Whether a result is what it should be with the recording as it is."""
    return not failed(result) and check_consistency(result).consistent


def doubts_found(
    results: Mapping[str, xr.Dataset],
    estimators: Mapping[str, AbstractEstimator],
    judges: Judges,
) -> dict[str, list[str]]:
    """Say of every result which parameters make no sense, are hardly told, or not from a force.

    And before them which readings are not what they are taken for.
    """
    model, recording = judges.model, judges.recording
    walks = Walks(judges)
    read = turned_readings(model, recording) + clipped_readings(model, recording)
    large = model.nx > MOST_STATES
    return {
        name: read
        + coarse_readings(estimator, model, recording)
        + (
            []
            if estimator.innovations == "forced" or failed(results[name])
            else lone_readings(estimator, results[name])
        )
        + misled_constants(results[name])
        + (
            []
            if large or estimator.innovations == "forced" or failed(results[name])
            else [
                *behind_kinks(estimator, model, results[name]),
                *surprises(estimator, judges, results[name]),
                *walks.doubts(estimator, results[name]),
            ]
        )
        for name, estimator in estimators.items()
    }


def noise_found(
    results: Mapping[str, xr.Dataset],
    estimators: Mapping[str, AbstractEstimator],
    judges: Judges,
) -> dict[str, NoiseFactors | None]:
    """By how much the noise of every estimator is wrong, where that can be told.

    From its own innovations and covariances if they are those of a Kalman filter. The innovations
    of another gain are coloured whatever the noise is, and with a lag the covariance is not that of
    the newest sample: the noise is then judged by the Kalman filter that believes in the same.
    """
    model = judges.model
    found: dict[str, NoiseFactors | None] = {}
    for name, estimator in estimators.items():
        if estimator.innovations == "white" and not estimator.delay:
            found[name] = factors_of(results[name], estimator, model)
        elif estimator.innovations == "forced" or model.nx > MOST_STATES:
            found[name] = None
        else:
            found[name] = _by_yardstick(estimator, judges)
    return found


def _by_yardstick(estimator: AbstractEstimator, judges: Judges) -> NoiseFactors | None:
    """Factors by the Kalman filter with the same noise and prior.

    Of it size and colour of the innovations are known if the noise is right. That they are not
    what they should be is asked here, since those of the estimator itself cannot tell.
    """
    try:
        judge = yardstick(estimator, judges.model)
    except BacksightError:
        return None
    result = judges.result(judge)
    found = None if result is None else factors_of(result, judge, judges.model)
    if result is None or found is None:
        return None
    seen = check_consistency(result)
    return dataclasses.replace(found, doubted=not seen.sized or seen.coloured is not None)


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


def expected(
    estimators: Mapping[str, AbstractEstimator], model: Model, recording: xr.Dataset
) -> Identifiability | None:
    """Foretell the bands of constant parameters by the first estimator with a noise and a prior.

    None if there are none, the model has many states, or its motion does not stay finite.
    """
    if model.nx > MOST_STATES:
        return None
    for estimator in estimators.values():
        try:
            found = check_identifiability(estimator, model, recording)
        except (TuningError, ModelError):
            continue
        return found if found.parameters else None
    return None
