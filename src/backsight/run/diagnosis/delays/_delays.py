"""Find out whether outputs and inputs of a recording are aligned, and in the model's units."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Annotated

import numpy as np
import xarray as xr

from backsight.analysis.alignment import Alignment, decide, vertex
from backsight.description import Called, Count, checked
from backsight.engine.execute import choose_engine, prepare
from backsight.engine.recursion import Recursion
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.outliers import DOUBTED
from backsight.models.model import Model
from backsight.run.diagnosis.delays._units import outputs_of_run, reconsidered, response_ratios
from backsight.run.diagnosis.delays._without_delay import explained_without
from backsight.run.estimation import match
from backsight.schema import WEIGHT
from backsight.types import Array

Scores = tuple[dict[int, Array], dict[int, float]]

REACH = 5
"""Samples either way that are tried."""

MOST = 24_000
"""Samples that are looked at, from the first on."""

SHARED = 24_000
"""Samples that the outputs share, where each of them is moved by itself."""

FINE = 0.25
"""Fraction of a sample by which the input is moved to find the delay between whole ones."""

OWN = 10
"""Innovations before a sample that may explain its own, whatever the input does."""

START = 0.1
"""Share of the recording in which the estimates settle; it has no vote."""


@checked()
def check_alignment(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    reach: Annotated[Count, Called("the reach", "samples")] = REACH,
) -> Alignment:
    """Look for a delay between outputs and inputs, and for wrong units and signs.

    An extended Kalman filter with the estimator's noise and prior predicts the outputs with y moved
    against u by every number of samples; if one of them predicts better than none, in nearly all
    parts of the recording, y is late or early by that much. Before that, the outputs are compared
    with the model's own response to the recorded input, see `alignment_scale`.

    Parameters
    ----------
    estimator : AbstractEstimator
        Its noise, prior and way between the samples are used.
    model : Model
        As for the estimator, with what is unknown among its states.
    recording : xarray.Dataset
    reach : int
        Samples either way that are tried.

    Returns
    -------
    Alignment

    Raises
    ------
    DataError
        If recording and model do not fit.
    TuningError, ModelError
        If estimator and model do not fit, or `reach` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> spring, u = bs.sdof(k=40.0, b=0.8), np.random.default_rng(0).standard_normal((200, 1))
    >>> recording = bs.simulate(spring, u, dt=0.05, sigma_y=1e-4, seed=1)
    >>> ekf = bs.EKF(bs.Noise(sigma_y=1e-4, sigma_w=1e-5), bs.Prior(sigma_x0=0.1))
    >>> bs.check.check_alignment(ekf, spring, recording).sound
    True
    """
    predicting = yardstick(estimator, model)
    data = [part[:MOST] for part in match(model, recording, estimator=predicting)]
    dt = float(recording.attrs["dt"])
    plain = dataclasses.replace(predicting.noise, outliers=None)
    recursion = dataclasses.replace(predicting, noise=plain).compile(model, dt)
    engine = choose_engine(None, (2 * reach + 2) * len(data[0]))
    prepare(recursion, engine)
    u, y, mask = data
    if predicting.outliers is not None:
        # The same samples for every shift: a gate would leave out more where it fits worse.
        (weight,) = outputs_of_run(predicting.compile(model, dt), data, "vm", (WEIGHT,))
        mask = mask * (weight >= DOUBTED)
    names = [s.name for s in model.outputs]
    # Readings that start anew after a turn have another size than the response.
    whole = mask * np.array([s.wrap is None for s in model.outputs])
    ratios = response_ratios(recursion, u, y, whole, engine=engine, names=names) if model.nu else ()
    if any(r.factor != 1.0 for r in ratios):
        ratios = reconsidered(ratios, predicting, model, dt=dt, data=(u, y, mask), engine=engine)
    if model.nu == 0 or len(u) < 20 * reach:
        return decide({}, {}, ratios)
    y = y / np.array([r.factor for r in ratios])
    kept = slice(max(reach, int(START * len(u))), len(u) - reach)
    rows = range(len(u))

    def tried(shifts: Iterable[int], which: slice, command: Array, until: int) -> Scores:
        """Scores with some outputs moved; those of the samples before `until`."""
        scores, sizes = {}, {}
        for shift in shifts:
            columns = [v.copy() for v in (y[:until], mask[:until])]
            for column in columns:
                column[:, which] = _moved(column[:, which], shift)
            e, S = outputs_of_run(recursion, [command[:until], *columns], engine, ("e", "S"))
            back = shift if which == slice(None) else 0
            at = slice(kept.start, min(kept.stop, until - reach))
            seen = (mask if back or not shift else columns[1])[:until]
            found = _score(_moved(e, -back)[at], _moved(S, -back)[at], seen[at])
            if found is not None:
                scores[shift], sizes[shift] = found
        return scores, sizes

    every = slice(None)

    def scored(begun: Recursion, shift: int) -> tuple[float, Array] | None:
        """Mean score and last estimate of a run from another start, with y moved."""
        moved = [_moved(v, shift) for v in (y, mask)]
        e, S, x = outputs_of_run(begun, [u, *moved], engine, ("e", "S", "x_hat"))
        found = _score(_moved(e, -shift)[kept], _moved(S, -shift)[kept], mask[kept])
        return found and (float(found[0].mean()), x[kept.stop - 1])

    result = decide(*tried(range(-reach, reach + 1), every, u, len(rows)), ratios)
    if not result.shifts:
        return result
    if result.late and explained_without(predicting, model, recursion, result.best, scored):
        return dataclasses.replace(result, explained=True)
    fine = {}
    for part in FINE * np.arange(-3, 4):
        scores, _ = tried([result.best], every, _later(u, float(part)), len(u))
        fine |= {result.best + float(part): v for v in scores.values()}
    result = dataclasses.replace(result, fine=vertex(fine))
    sensors = {i: s.name for i, s in enumerate(model.outputs) if s.dummy is None}
    if len(sensors) < 2:
        return result
    few = max(SHARED // len(sensors), 40 * reach)
    channels = []
    for i, name in sensors.items():
        alone = decide(*tried(range(-reach, reach + 1), slice(i, i + 1), u, min(few, len(u))), ())
        channels.append((name, alone))
    return dataclasses.replace(result, channels=tuple(channels))


def _later(u: Array, part: float) -> Array:
    """Inputs so many samples later, -1 to 1; held ones by their mean over the period."""
    size = abs(part)
    other = np.vstack([u[:1], u[:-1]]) if part > 0 else np.vstack([u[1:], u[-1:]])
    return (1 - size) * u + size * other


def _score(e: Array, S: Array, mask: Array) -> tuple[Array, float] | None:
    """Log-likelihood per measured value and sample, and the size of the normalised innovations.

    One common factor of all covariances is fitted: how large the noise is shall not matter. What
    innovations owe to those before them is taken out of the likelihood: an unknown force makes
    them follow from each other, and moving y must not be praised for that. None if the filter
    diverged.
    """
    variance = np.einsum("kii->ki", S)
    seen = mask > 0
    if not (np.isfinite(e).all() and np.isfinite(variance).all() and (variance > 0).all()):
        return None
    with np.errstate(over="ignore"):
        squares = np.where(seen, e**2 / variance, 0.0)
        level = float(squares.sum() / max(seen.sum(), 1))
    if not 0 < level < math.inf:
        return None
    new = np.where(seen, _new(np.where(seen, e / np.sqrt(variance), 0.0)) ** 2, 0.0)
    fresh = float(new.sum() / max(seen.sum(), 1))
    if not 0 < fresh < math.inf:
        return None
    values = np.where(seen, new / fresh + np.log(fresh * variance), 0.0)
    return -0.5 * values.mean(axis=1), math.sqrt(level)


def _new(z: Array) -> Array:
    """What is new in normalised innovations (n, ny), beyond the last ones of the same output."""
    found = z.copy()
    for i in range(z.shape[1]):
        past = np.column_stack([_moved(z[:, i : i + 1], -lag)[:, 0] for lag in range(1, OWN + 1)])
        found[:, i] -= past @ np.linalg.lstsq(past, z[:, i], rcond=None)[0]
    return found


def _moved(values: Array, shift: int) -> Array:
    """Move rows to earlier places; what comes in at the end is zero: not measured."""
    moved = np.zeros_like(values)
    n = len(values)
    if shift >= 0:
        moved[: n - shift] = values[shift:]
    else:
        moved[-shift:] = values[:shift]
    return moved
