"""Hits between the places and the samples, by a fit of pulses to a whole recording."""

import math

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.errors import DataError, TuningError
from backsight.estimators.dictionaries import AbstractPulses, ForceLine, MovingLoads
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run._hit_table import hit_table
from backsight.run.sparse_forces import prepared
from backsight.sparse.pulses.pulse_fit import (
    Course,
    Pulse,
    PulseDrawing,
    PulseFit,
    Reach,
    drawing,
    fitted,
)
from backsight.sparse.pulses.pulse_offers import AROUND, PulseOffer, pulse_offers
from backsight.types import Array

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
    >>> import numpy as np
    >>> places = {"a": 0.2, "b": 0.3, "c": 0.4}
    >>> beam = bs.beam(
    ...     0.405, width=0.025, thickness=0.003, youngs_modulus=65.9e9, density=7502.0, modes=2,
    ...     damping=0.03, forces=places,
    ...     sensors={"s": ("displacement", 0.25), "t": ("displacement", 0.4)},
    ... )
    >>> hit = np.zeros((60, 3))
    >>> hit[20, 1] = 5.0
    >>> struck = bs.forces.forces_as_inputs(beam, list(places))
    >>> recording = bs.simulate(struck, hit, dt=1 / 400, sigma_y=1e-6, seed=1)
    >>> method = bs.CompressiveSensingMHE(
    ...     bs.Noise(sigma_y=1e-6), bs.Prior(sigma_x0=1e-4), forces=("a", "b", "c"), lam=5.0
    ... )
    >>> found = bs.forces.find_sparse_forces(method, beam, recording)
    >>> line = bs.forces.ForceLine(tuple(places.values()), supports=(0.0,))
    >>> hits = bs.forces.locate_hits(method, beam, recording, found, line=line)
    >>> round(float(hits["place"][0]), 3)  # [m]
    0.3
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
    fit = _settled(drawn, target, pulse_offers(drawn, d))
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


def _settled(drawn: PulseDrawing, target: Array, offers: list[PulseOffer]) -> PulseFit:
    """One pulse for every hit; more where a hit was several, fewer where noise would do."""
    price = 2 * math.log(drawn.samples * len(drawn.line.places))
    pulses: list[Pulse] = []
    for offer in offers[:-1]:
        pulses += offer.promising(drawn, target, pulses)[:1]
    reach = [offer.reach for offer in offers]
    fit = _with(drawn, target, pulses, offers[-1], reach)
    fit, reach = _fewer(drawn, target, fit, reach, price)
    while True:
        found = [offer.gains(drawn, target, fit.pulses).max() for offer in offers]
        offer = offers[int(np.argmax(found))]
        if max(found) < price:
            return fit
        longer = [*reach, offer.reach]
        more = _with(drawn, target, fit.pulses, offer, longer)
        more, left = _fewer(drawn, target, more, longer, price)
        if not more.cost < fit.cost - price:
            return fit
        fit, reach = more, left


def _with(
    drawn: PulseDrawing, target: Array, beside: list[Pulse], offer: PulseOffer, reach: list[Reach]
) -> PulseFit:
    """The best fit with one more pulse of an offer."""
    more = offer.promising(drawn, target, beside)
    fits = [fitted(drawn, target, [*beside, pulse], reach) for pulse in more]
    return min(fits, key=lambda fit: fit.cost)


def _fewer(
    drawn: PulseDrawing, target: Array, fit: PulseFit, reach: list[Reach], price: float
) -> tuple[PulseFit, list[Reach]]:
    """Leave out, the smallest first, every pulse that gains less than its price."""
    start = np.array([pulse.start for pulse in fit.pulses])
    for i in map(int, np.argsort(fit.worth)):
        if len(fit.pulses) == 1:
            break
        near = np.abs(start - start[i]).argsort()[1]
        # One that is sure and alone is worth what it gains; of two side by side one may do.
        if fit.worth[i] > SURE * price and abs(start[near] - start[i]) > 2 * AROUND:
            continue
        rest, left = fit.pulses[:i] + fit.pulses[i + 1 :], reach[:i] + reach[i + 1 :]
        fewer = fitted(drawn, target, rest, left)
        if fewer.cost < fit.cost + price + reach[i].free:
            return _fewer(drawn, target, fewer, left, price)
    return fit, reach
