"""Hits between the places and the samples, by a fit of pulses to a whole recording."""

import dataclasses
import math

import numpy as np
import scipy
import xarray as xr

from backsight.description import checked
from backsight.errors import DataError, TuningError
from backsight.estimators.dictionaries import AbstractPulses, ForceLine, MovingLoads
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run._hit_table import hit_table
from backsight.run.sparse_forces import prepared
from backsight.sparse.pulse_fit import (
    Course,
    Pulse,
    PulseDrawing,
    PulseFit,
    Reach,
    best,
    drawing,
    fitted,
    grid,
)
from backsight.sparse.regression import Indices
from backsight.types import Array

AROUND = 1.5
"""How far a pulse may begin from where it was selected [samples]."""

FINE = 4
"""Beginnings that are tried per sample, and places per distance of two places."""

SURE = 4.0
"""Prices that a pulse must gain to be left alone."""


@checked()
def locate_hits(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    found: xr.Dataset,
    *,
    line: ForceLine | None = None,
) -> xr.Dataset:
    r"""Find place, moment and width of hits between the places and the samples.

    What was selected lies on a grid of places and samples. From there, every hit is one pulse of
    the estimator's dictionary at any place of a line, which begins at any time; if the dictionary
    has several widths, the width is free between the smallest and the largest. All of them are
    fitted together to the whole recording, without penalty; what is then no longer than noise
    could be, is dropped. Within a sample the response is that of the continuous model.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        As for `find_sparse_forces`. Its dictionary says what a hit looks like: `HalfSines`,
        `Haversines`, `Splines`, `Decays`, `SteadyLoads`, or `Impulses`, a force held for one
        sampling period; or `MovingLoads`.
    model : Model
        In continuous time.
    recording : xarray.Dataset
    found : xarray.Dataset
        Result with ``d_hat`` for this recording, of `find_sparse_forces` or of `estimate`. Forces
        at neighbouring places and steps are one hit at first, and more if one does not explain
        them.
    line : ForceLine, optional
        Where the places are; that of `MovingLoads`, which have one, is taken.

    Returns
    -------
    xarray.Dataset
        By ``hit``, in the order of time: ``place`` [m]; ``time``, the centre of gravity of the
        force, and ``start`` [s]; ``size``, the height of the pulse [its unit]; ``impulse``;
        ``width`` [s], as the dictionary counts it; of a load that moves ``speed`` [m/s], its place
        is where it comes on the line. Each has a standard deviation ``<name>_std``, 0 of what is
        fixed. Attributes ``chi2``, the sum of the squared white innovations, and ``measured``,
        their number.

    Raises
    ------
    TuningError
        If the dictionary has no course, a line is missing or does not fit, or the model is in
        discrete time.
    DataError
        If the result is not about these forces and this recording.

    Examples
    --------
    >>> line = bs.forces.ForceLine(places=(0.125, 0.165, 0.205), supports=(0.0,))  # doctest: +SKIP
    >>> bs.forces.locate_hits(method, beam, recording, found, line=line)  # doctest: +SKIP
    """
    if not model.continuous:
        raise TuningError(
            f"model '{model.name}' is in discrete time and does not say what a force does between "
            "the samples; give it as a continuous one"
        )
    course, line = _described(estimator, line)
    line.check(len(estimator.forces))
    search = prepared(estimator, model, recording)
    filter_, sign = search.filter, _sign(estimator)
    drawn = drawing(model, filter_, course=course, line=line, sign=sign)
    d = _selected(found, estimator.forces, len(filter_.y))
    target = search.regression.target
    fit = _settled(drawn, target, _offers(drawn, d))
    dt = filter_.forced.system.s.dt
    hits = hit_table(fit, drawn, dt, float(recording["time"].values[0]))
    hits.attrs = {"chi2": fit.cost, "measured": int((filter_.mask > 0).sum()), "model": model.name}
    return hits


def _described(
    estimator: AbstractForceEstimator, line: ForceLine | None
) -> tuple[Course, ForceLine]:
    match estimator.dictionary:
        case MovingLoads() as course:
            if line is not None and line != course.line:
                raise TuningError(
                    "the line is not that of the dictionary MovingLoads; leave it out"
                )
            return course, course.line
        case AbstractPulses() as course:
            if line is None:
                raise TuningError(
                    "between places a line is needed that says where they are: "
                    "line = ForceLine(places = (...)), one position for every force"
                )
            return course, line
        case other:
            raise TuningError(
                f"a dictionary {type(other).__name__} does not say what a hit looks like between "
                "the samples; take HalfSines, Haversines, Splines, Decays, SteadyLoads, Impulses "
                "or MovingLoads"
            )


def _sign(estimator: AbstractForceEstimator) -> float:
    """The sign that all hits have, 0 if any."""
    sides = np.unique(estimator.sides())
    if len(sides) > 1:
        raise TuningError(
            "only some of the forces have a known sign, which cannot be kept between their places; "
            "give all of them, or none"
        )
    return float(sides[0])


def _selected(found: xr.Dataset, names: tuple[str, ...], samples: int) -> Array:
    """Forces (samples, forces) that were selected."""
    if "d_hat" not in found or [str(n) for n in found["force"].values] != list(names):
        raise DataError(
            "found is no result with the forces of this estimator; make it with "
            "find_sparse_forces or estimate"
        )
    d = np.nan_to_num(found["d_hat"].values)
    if len(d) != samples:
        raise DataError(f"found has {len(d)} samples; the recording has {samples}")
    if not d.any():
        raise DataError("found has no forces; there is nothing to locate")
    return d


@dataclasses.dataclass(frozen=True)
class _Offer:
    """Pulses from which the fit of a hit may begin, and how far it may go.

    Parameters
    ----------
    pulses : list of Pulse
    columns : (n ny, pulses) array
        What they explain.
    reach : Reach
    """

    pulses: list[Pulse]
    columns: Array
    reach: Reach


def _offers(drawn: PulseDrawing, d: Array) -> list[_Offer]:
    """What may stand for the selected forces, the largest first."""
    if isinstance(drawn.course, MovingLoads):
        return [_loads(drawn, drawn.course, np.flatnonzero(d.any(axis=1)))]
    order = np.argsort(drawn.line.places)
    number, count = scipy.ndimage.label(d[:, order] != 0, structure=np.ones((3, 3)))
    hits = [np.nonzero(number == i + 1) for i in range(count)]
    hits.sort(key=lambda cells: -np.abs(d[:, order][cells]).max())
    return [_hit(drawn, drawn.course, steps, order[along]) for steps, along in hits]


def _loads(drawn: PulseDrawing, course: MovingLoads, steps: Indices) -> _Offer:
    """Loads that move; they come on the line before or while there are forces."""
    place, crossings = drawn.line.ends[0], np.array(course.crossings, float)
    longest = np.abs(crossings).max()
    starts = np.arange(max(steps.min() - longest // 4, -longest), steps.max() + 1)
    pulses = grid((np.array([place]), starts, crossings))
    wide = np.array([crossings.min(), crossings.max()]) + np.array([-0.1, 0.1]) * longest
    reach = Reach(
        np.array([place, starts[0] - AROUND, wide[0]]), np.array([place, starts[-1], wide[1]])
    )
    return _Offer(pulses, drawn.columns(pulses), reach)


def _hit(drawn: PulseDrawing, course: AbstractPulses, steps: Indices, forces: Indices) -> _Offer:
    """Hits around some cells of the grid, of steps and forces that touch each other."""
    positions = np.array(drawn.line.places)
    apart = float(np.diff(np.sort(positions)).max(initial=0.0)) or float(np.ptp(drawn.line.ends))
    low = max(positions[forces].min() - apart, drawn.line.ends[0])
    high = min(positions[forces].max() + apart, drawn.line.ends[1])
    places = np.linspace(low, high, max(2, round((high - low) / apart * FINE) + 1))
    first, last = steps.min() - AROUND, steps.max() + AROUND
    starts = np.arange(first, min(last, first + 2 * AROUND) + 1e-9, 1 / FINE)
    widths = np.array(course.lengths, float)
    pulses = grid((places, starts, widths))
    reach = Reach(
        np.array([low, first - AROUND, widths.min()]), np.array([high, last + AROUND, widths.max()])
    )
    return _Offer(pulses, drawn.columns(pulses), reach)


def _settled(drawn: PulseDrawing, target: Array, offers: list[_Offer]) -> PulseFit:
    """One pulse for every hit; more where a hit was several, fewer where noise would do."""
    price = 2 * math.log(drawn.samples * len(drawn.line.places))
    pulses: list[Pulse] = []
    for offer in offers:
        chosen, _ = best(offer.columns, target, drawn.columns(pulses), sign=drawn.sign)
        pulses.append(offer.pulses[chosen])
    reach = [offer.reach for offer in offers]
    fit, reach = _fewer(drawn, target, fitted(drawn, target, pulses, reach), reach, price)
    while True:
        beside = drawn.columns(fit.pulses)
        tried = [best(offer.columns, target, beside, sign=drawn.sign) for offer in offers]
        i = int(np.argmax([gain for _, gain in tried]))
        if tried[i][1] < price:
            return fit
        longer = [*reach, offers[i].reach]
        more = fitted(drawn, target, [*fit.pulses, offers[i].pulses[tried[i][0]]], longer)
        more, left = _fewer(drawn, target, more, longer, price)
        if not more.cost < fit.cost - price:
            return fit
        fit, reach = more, left


def _fewer(
    drawn: PulseDrawing, target: Array, fit: PulseFit, reach: list[Reach], price: float
) -> tuple[PulseFit, list[Reach]]:
    """Leave out, the smallest first, every pulse that gains less than its price."""
    start = np.array([pulse.start for pulse in fit.pulses])
    for i in map(int, np.argsort(fit.gains)):
        if len(fit.pulses) == 1:
            break
        near = np.abs(start - start[i]).argsort()[1]
        # One that is sure and alone is worth what it gains; of two side by side one may do.
        if fit.gains[i] > SURE * price and abs(start[near] - start[i]) > 2 * AROUND:
            continue
        rest, left = fit.pulses[:i] + fit.pulses[i + 1 :], reach[:i] + reach[i + 1 :]
        fewer = fitted(drawn, target, rest, left)
        if fewer.cost < fit.cost + price + reach[i].free:
            return _fewer(drawn, target, fewer, left, price)
    return fit, reach
