"""The values that a fit may change: found in estimator and model by their names."""

import dataclasses
from collections.abc import Sequence

from backsight.errors import TuningError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.tune.fitting.values import _readers as read
from backsight.tune.fitting.values._free import Free
from backsight.tune.fitting.values._settings import numeric_settings
from backsight.tune.fitting.values._unknown import Unknown


def unknowns_of(
    free: Sequence[Free], estimator: AbstractEstimator, model: Model
) -> tuple[Unknown, ...]:
    """Resolve names.

    Raises
    ------
    TuningError
        If a name is unknown or means two things, two of them mean the same, or a start value is
        none.
    """
    found = [u for f in free for u in _resolved(f, estimator, model)]
    if not found:
        raise TuningError("nothing is free: name a value, such as free=['sigma_y', 'sigma_w']")
    names = [u.name for u in found]
    twice = [n for i, n in enumerate(names) if n in names[:i]]
    if twice:
        raise TuningError(f"free names '{twice[0]}' twice")
    _refuse_overlaps(found)
    return tuple(found)


def _refuse_overlaps(found: Sequence[Unknown]) -> None:
    words = {u.matrix.word for u in found if u.matrix is not None}
    for whole, parts in (("R", "sigma_y"), ("P0", "sigma_x0")):
        kinds = {u.kind for u in found} | words
        if whole in kinds and parts in kinds:
            raise TuningError(f"'{whole}' and '{parts}' change the same covariance: free one")
    walks = [u.entry for u in found if u.kind == "walk"]
    if walks and words & {"Q", "Qc"}:
        raise TuningError("a structure is all of the process noise: free nothing of it beside it")
    for matrix in ("Q", "Qc"):
        if matrix in walks and len(walks) > 1:
            raise TuningError(
                f"'{matrix}' is a factor of all process noise: free nothing beside it"
            )


def _resolved(free: Free, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    group, _, entry = free.name.partition(".")
    readers = {
        "sigma_y": read.sensor_deviations,
        "sigma_w": read.walking_deviations,
        "sigma_x0": read.prior_deviations,
        "x0": read.start_values,
        "R": read.whole_factor,
        "P0": read.whole_factor,
        "Q": read.walk_entry,
        "Qc": read.walk_entry,
    }
    if free.structure != "scale":
        return read.matrix_entries(free, estimator, model)
    if group in readers:
        estimator.assumed  # noqa: B018 - raises if it has none
        return readers[group](free, entry, estimator, model)
    parameters = [s.name for s in model.parameters]
    settings = [*numeric_settings(estimator), *estimator.multiplied_settings]
    if free.name in parameters and free.name in settings:
        raise TuningError(
            f"'{free.name}' is a parameter of the model and a setting of the estimator; rename it"
        )
    if free.name in parameters:
        return [read.model_parameter(free, model)]
    if isinstance(estimator, AbstractForceEstimator) and free.name in ("lam", "threshold"):
        raise TuningError(
            f"'{free.name}' decides how many forces there are, which no likelihood can say: free "
            "lam alone, then threshold alone, or take one of the ways in bs.tune that begin with "
            "lambda_from"
        )
    if free.name in settings:
        return [read.estimator_setting(free, estimator)]
    if by_name := [s for s in settings if s.startswith(f"{free.name}.") and s.count(".") == 1]:
        named = [dataclasses.replace(free, name=s) for s in by_name]
        return [read.estimator_setting(f, estimator) for f in named]
    if group in (forces := [g.states[0] for g in model.driven if g.process is not None]):
        return read.process_numbers(free, group, entry, model)
    if group == "delay":
        return [read.channel_delay(free, entry, model)]
    known = [*readers, "delay", *parameters, *settings, *(f"{name}.sigma" for name in forces)]
    raise TuningError(f"'{free.name}' cannot be free: {nearest(free.name, known)}")
