"""Find settings of an estimator, and constants of its model, from recordings without truth."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from backsight.description import Count, Whole, checked
from backsight.errors import DataError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.estimation import check_window, match
from backsight.tune.fitting._descent import Search
from backsight.tune.fitting._tuning import Tuning
from backsight.tune.fitting._weight import tuned_threshold, tuned_weight
from backsight.tune.fitting.criteria import AbstractCriterion, Likelihood, MultiStep
from backsight.tune.fitting.runners import Data
from backsight.tune.fitting.tuned import Tuned
from backsight.tune.fitting.values import Choice, Free, Unknown, unknowns_of
from backsight.types import Array

OUTLIERS = 0.02
"""Share of outliers that a likelihood reckons with, if the noise has a rule for them."""


@checked()
def fit(
    estimator: AbstractEstimator,
    model: Model,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    free: Sequence[str | Free | Choice],
    criterion: AbstractCriterion | None = None,
    restarts: Whole = 2,
    passes: Count = 100,
    check: bool = True,
    seed: Whole = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> Tuned:
    r"""Tune an estimator by its own predictions of the measurements; no truth is needed.

    The values are those with which the recordings are most likely, and what was known of them
    before: with the criterion J of the innovations (`Likelihood` if not given), and a prior around
    the start values on the scale :math:`t` of every value, its logarithm if it is positive,

    .. math:: \min_t\; J(t) + \tfrac12 \sum_i (t_i / \sigma_i)^2 .

    Fisher scoring in a trust region. The derivatives come from runs with slightly other values, in
    the lanes of the processor's vectors beside that of the values themselves; nothing is compiled
    again. The first places are found in an excerpt of 10 000 samples, from several starts.

    Parameters
    ----------
    estimator : AbstractEstimator
        Its noise, prior and settings are where the search starts.
    model : Model
    recordings : xarray.Dataset, or sequence of them
        All enter one estimate.
    free : sequence of str, Free or Choice
        What to find, see `Free`; a name alone has the usual prior. Settings that are whole numbers
        or words are a `Choice`.
    criterion : AbstractCriterion, optional
    restarts : int
        Random places from which the search starts again, where values run in lanes.
    passes : int
        Passes over the recordings at most; profiles and the look at the halves not counted.
    check : bool
        Look at profiles of the criterion, and at how values of the first half of every recording
        do in the second.
    seed : int
        Of the restarts.
    progress : callable
        Told the share of the passes that are done; the search mostly ends before all are.

    Returns
    -------
    Tuned

    Raises
    ------
    TuningError
        If a name cannot be free, or the estimator fails with the start values.
    ModelError, DataError, EngineError
        As `estimate`.

    Notes
    -----
    Noise and prior of Kalman filters, `sigma_y` of all estimators that weigh samples, parameters of
    models, delays, and the settings that methods name in `varied_settings` run in lanes; the noise,
    prior and delays of inputs of a Kalman filter with constant matrices by these alone. Anything
    else is built anew for every value, which takes as long as it takes to build an estimator. The
    weight `lam` of sparse forces is found by itself, by `lambda_from_scaled_noise`, and so is their
    threshold, by `threshold_from_noise`. Of a linear model with free parameters the
    filter is the extended one with a Runge-Kutta method.

    References
    ----------
    Gupta, Mehra, "Computational aspects of maximum likelihood estimation and reduction in
    sensitivity function calculations", IEEE Transactions on Automatic Control 19 (1974) 774-783,
    doi:10.1109/TAC.1974.1100714.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 300, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-2, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> tuned = bs.tune.fit(kf, spring, recording, free=["sigma_y"], check=False, restarts=0)
    >>> print(f"{tuned.values['sigma_y.y']:.4f}")
    0.0009
    """
    given = [recordings] if isinstance(recordings, xr.Dataset) else list(recordings)
    if not given:
        raise DataError("there is no recording")
    wanted = [Free(f) if isinstance(f, str) else f for f in free]
    if isinstance(estimator, AbstractForceEstimator) and len(wanted) == 1:
        alone = {"lam": tuned_weight, "threshold": tuned_threshold}
        if wanted[0].name in alone and isinstance(wanted[0], Free):
            return alone[wanted[0].name](estimator, model, given)
    choices = [f for f in wanted if isinstance(f, Choice)]
    unknowns: tuple[Unknown, ...] = ()
    if len(choices) < len(wanted) or not wanted:
        unknowns = unknowns_of([f for f in wanted if isinstance(f, Free)], estimator, model)
    _check_groups(unknowns, len(given))
    periods = [float(r.attrs["dt"]) for r in given]
    criterion = criterion or _usual(estimator, unknowns, choices)
    criterion = criterion.fitted(estimator, model, periods[0])
    data = [_data(estimator, model, r, criterion) for r in given]
    samples = sum(len(d[0]) for d in data)
    search = Search(passes, lambda done: progress(min(done / passes, 1.0)), samples)
    tuning = Tuning(estimator, model, tuple(data), tuple(periods), criterion, search)
    objective = tuning.objective(unknowns)
    start: Array = np.zeros(len(objective.coordinates))
    place, worse = start, []
    if unknowns:
        best, worse = tuning.search(objective, restarts=restarts, seed=seed)
        place = best.place
        before = search.evaluate(objective, start).data.cost  # where the search began
    else:
        before = objective.cost_at([start])[0]
    options: dict[str, object] = {}
    table = None
    if choices:
        # With wrong values no option is right: these come first, and again afterwards.
        chosen, table = tuning.option(choices, unknowns, objective, place)
        options = {c.name: o for c, o in zip(choices, chosen.options, strict=True)}
        tuning = dataclasses.replace(tuning, estimator=chosen.estimator)
        objective = tuning.objective(unknowns)
    found = tuning.tuned(unknowns, objective, place, worse, check=check)
    return dataclasses.replace(found, before=before, chosen=options, choices=table)


def _usual(
    estimator: AbstractEstimator, unknowns: Sequence[Unknown], choices: Sequence[Choice]
) -> AbstractCriterion:
    """The likelihood; of settings of windows alone, whose covariances decide nothing, squares."""
    settings = all(u.kind == "setting" for u in unknowns)
    if estimator.horizon and settings and not isinstance(estimator, AbstractForceEstimator):
        return MultiStep()
    del choices
    return Likelihood(outliers=OUTLIERS if estimator.outliers is not None else 0.0)


def _check_groups(unknowns: Sequence[Unknown], recordings: int) -> None:
    for u in unknowns:
        if isinstance(u.per, tuple) and len(u.per) != recordings:
            raise TuningError(
                f"'{u.name}' has {len(u.per)} groups for {recordings} recordings: give the group "
                "of every recording"
            )


def _data(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset, criterion: AbstractCriterion
) -> Data:
    """Data of a recording; what the criterion hides is judged alone."""
    u, y, mask = match(model, recording, estimator=estimator)
    check_window(estimator, len(u))
    if not mask.any():
        raise DataError("nothing was measured in the recording")
    hidden = np.asarray(criterion.hidden(len(u)), bool)
    if not hidden.any():
        judged = mask.copy()
        judged[: criterion.alone] = 0
        return u, y, mask, y, judged
    seen, judged = mask.copy(), mask.copy()
    seen[hidden] = 0
    judged[~hidden] = 0
    return u, y, seen, y, judged
