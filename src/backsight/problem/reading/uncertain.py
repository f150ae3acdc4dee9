"""The tables ``[noise]`` and ``[prior]``, with what the unknowns say of themselves."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.errors import ProblemError
from backsight.estimators.outliers import Gate, Huber, StudentT
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.problem.reading.checking import at
from backsight.problem.reading.settings import part
from backsight.problem.reading.tables import EstimateTable, NoiseTable, PriorTable
from backsight.types import Array

RULES = (Gate, StudentT, Huber)
"""Rules for outliers that a file may give; the first without ``kind``."""

Unknowns = Mapping[str, EstimateTable]
"""Parameters and disturbances that are estimated."""


def noise(
    table: NoiseTable,
    unknowns: Unknowns,
    model: Model,
    sensors: Mapping[str, float],
    *,
    where: str,
) -> Noise:
    """Join the noise with the walks of unknowns, and of outputs that say their own; check it."""
    walks = {name: entry.walk for name, entry in unknowns.items() if entry.walk}
    for key in ("Q", "Qc"):
        if getattr(table, key) is not None and walks:
            _twice(f"{where}.{key}", next(iter(walks)), "walk")
    if table.R is not None and sensors:
        _twice(f"{where}.R", next(iter(sensors)), "noise")
    with at(where):
        made = Noise(
            sigma_y=_joined(table.sigma_y, sensors, f"{where}.sigma_y", "noise") or None,
            R=_matrix(table.R, f"{where}.R"),
            sigma_w=_joined(table.sigma_w, walks, f"{where}.sigma_w", "walk") or None,
            Q=_matrix(table.Q, f"{where}.Q"),
            Qc=_matrix(table.Qc, f"{where}.Qc"),
            sigma_u=table.sigma_u,
            sigma_p=table.sigma_p,
            cross=_matrix(table.cross, f"{where}.cross"),
            outliers=_rule(table.outliers, f"{where}.outliers"),
        )
        made.measurement(model, singular=True)
        made.process(model)
        made.density(model)
        made.of_inputs(model)
        made.of_parameters(model)
    return made


def _rule(given: Mapping[str, Any] | None, where: str) -> Gate | StudentT | Huber | None:
    return None if given is None else part(RULES, given, where=where)


def prior(table: PriorTable, unknowns: Unknowns, model: Model, *, where: str) -> Prior:
    """Join the prior with the start values of the unknowns, and check it against the model."""
    starts = {name: entry.start for name, entry in unknowns.items()}
    sigmas = {name: entry.sigma for name, entry in unknowns.items() if entry.sigma is not None}
    if table.P0 is not None and sigmas:
        _twice(f"{where}.P0", next(iter(sigmas)), "sigma")
    with at(where):
        made = Prior(
            x0=_joined(table.x0, starts, f"{where}.x0", "start"),
            sigma_x0=_joined(table.sigma_x0, sigmas, f"{where}.sigma_x0", "sigma") or None,
            P0=_matrix(table.P0, f"{where}.P0"),
        )
        made.mean(model)
        made.covariance(model)
    return made


def _joined(
    given: Mapping[str, float] | None, own: Mapping[str, float], where: str, key: str
) -> dict[str, float]:
    for name in given or {}:
        if name in own:
            _twice(f"{where}.{name}", name, key)
    return {**(given or {}), **own}


def _twice(where: str, name: str, key: str) -> None:
    raise ProblemError(f"{where}: '{name}' has a '{key}' of its own; leave out one of the two")


def _matrix(rows: list[list[float]] | None, where: str) -> Array | None:
    if rows is None:
        return None
    lengths = sorted({len(row) for row in rows})
    if len(lengths) != 1:
        raise ProblemError(f"{where}: its rows have different lengths: {lengths}")
    return np.array(rows, float)
