"""What a fit found."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import xarray as xr

from backsight.description import Printed
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.types import Array

CORRELATED = 0.9
"""Correlation of errors from which on it is shown."""


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """Cost of the second halves of the recordings, which the values of the first halves predict.

    Parameters
    ----------
    before, first_half, everything : float
        With the start values, with those found in the first halves, and with those found in
        everything.
    """

    before: float
    first_half: float
    everything: float


@dataclasses.dataclass(frozen=True)
class Tuned(Printed):
    """What a fit found, and how sure it is.

    Parameters
    ----------
    estimators, models : tuple
        With the values found, one for every recording; the same ones unless values are free per
        recording or group.
    late : tuple of dict
        By how much the samples of channels come late [s], for every recording.
    values, start, std : dict
        Every value by its name, what it was before, and the standard deviation of its error.
    units : dict
        Unit of every value.
    correlation : xarray.DataArray
        Of the errors, ``(value, value_)``.
    chosen : dict
        Options that were chosen.
    cost, before : float
        The criterion with the values found, and before. Of `Likelihood`, minus the logarithm.
    measured : int
        Measurements that count in it; 0 if it is no sum over them.
    doubts : tuple of str
        What could not be found and why, a sentence each.
    held_out : HeldOut or None
        None if it was not checked.
    profiles : xarray.Dataset or None
        ``value (name, point)`` and ``rise (name, point)``: by how much the criterion grows if a
        value is moved and the others follow.
    history : xarray.Dataset
        ``cost (evaluation)`` and ``value (evaluation, name)`` over the passes made so far.
    choices : xarray.Dataset or None
        ``cost (option)`` for a measurement, of the options that were compared.
    passes : float
        Passes over the recordings, parts counted as such.
    converged : bool
        Whether the search ended at an optimum.
    """

    estimators: tuple[AbstractEstimator, ...]
    models: tuple[Model, ...]
    late: tuple[Mapping[str, float], ...]
    values: Mapping[str, float]
    start: Mapping[str, float]
    std: Mapping[str, float]
    units: Mapping[str, str]
    correlation: xr.DataArray
    chosen: Mapping[str, object]
    cost: float
    before: float
    measured: int
    doubts: tuple[str, ...]
    held_out: HeldOut | None
    profiles: xr.Dataset | None
    history: xr.Dataset
    choices: xr.Dataset | None
    passes: float
    converged: bool

    @property
    def estimator(self) -> AbstractEstimator:
        """The estimator with the values found.

        Raises
        ------
        TuningError
            If it is another one for some recordings.
        """
        if any("[" in name for name in self.values):
            raise TuningError("values differ from recording to recording: use tuned.estimators[i]")
        return self.estimators[0]

    @property
    def model(self) -> Model:
        """The model with the values found; as `estimator`."""
        if any("[" in name for name in self.values):
            raise TuningError("values differ from recording to recording: use tuned.models[i]")
        return self.models[0]

    @property
    def delays(self) -> Mapping[str, float]:
        """Delays found by channel [s], for `backsight.data.remove_delays`; as `estimator`.

        If the only output is late, it is the inputs that are early: these have no noise that
        would be smoothed.
        """
        if any("[" in name for name in self.values):
            raise TuningError("values differ from recording to recording: use tuned.late[i]")
        return self.late[0]

    def __str__(self) -> str:
        head = f"Tuned: {self.estimators[0].title}"
        count = len(self.estimators)
        head += f", {count} recordings" if count > 1 else ""
        lines = [head, *self._table(), *self._chosen(), self._gain(), *self._correlated()]
        lines += [f"! {doubt}" for doubt in self.doubts]
        return "\n".join(lines)

    def _table(self) -> list[str]:
        rows = [("", "before", "found", "±", "")]
        for name, value in self.values.items():
            rows.append(
                (
                    name,
                    significant(self.start[name], 4),
                    significant(value, 4),
                    significant(self.std[name], 2),
                    self.units[name],
                )
            )
        widths = [max(len(row[i]) for row in rows) for i in range(4)]
        lines = []
        for name, *numbers, unit in rows:
            cells = [f"{n:>{w}}" for n, w in zip(numbers, widths[1:], strict=True)]
            lines.append("  ".join([f"{name:<{widths[0]}}", *cells, unit]).rstrip())
        return lines if self.values else []

    def _chosen(self) -> list[str]:
        return [f"{name} = {value}" for name, value in self.chosen.items()]

    def _gain(self) -> str:
        line = f"criterion {significant(self.before, 6)} -> {significant(self.cost, 6)}"
        if self.measured:
            each = significant((self.before - self.cost) / self.measured, 3)
            line += f", {each} better for each of {self.measured} measurements"
        if self.held_out is not None:
            gain = self.held_out.before - self.held_out.first_half
            line += f"; second half, from the first: {significant(gain, 4)} better than before"
        return f"{line}; {self.passes:.0f} passes"

    def _correlated(self) -> list[str]:
        names, rho = list(self.values), self.correlation.values
        pairs = [
            f"{names[i]} and {names[j]} {rho[i, j]:+.2f}"
            for i in range(len(names))
            for j in range(i)
            if abs(rho[i, j]) > CORRELATED
        ]
        return [f"errors go together: {', '.join(pairs)}"] if pairs else []


def correlation_of(names: list[str], covariance: Array) -> xr.DataArray:
    """Correlations by name."""
    size = np.sqrt(np.diag(covariance))
    rho = covariance / np.outer(size, size)
    return xr.DataArray(rho, dims=("value", "value_"), coords={"value": names, "value_": names})
