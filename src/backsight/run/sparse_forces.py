"""Sparse forces from a whole recording at once, after it has ended."""

import time
import warnings

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine.recursion import Channel
from backsight.errors import BacksightWarning
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.force_estimator import AbstractForceEstimator, Forced
from backsight.models.lti import is_linear
from backsight.models.model import Model
from backsight.run.estimation import as_result, match
from backsight.sparse import (
    AbstractSelection,
    Fit,
    ForceSearch,
    Greedy,
    MatricesInTime,
    force_search,
    free_motion,
    matrices_along,
)
from backsight.types import Array

PASSES = 30
"""Linearisations of a nonlinear model, at most."""

SETTLED = 1e-4
"""Change of the states, in standard deviations of their prediction, that is none."""

TINY = 1e-12
"""The same of a scaled state that is known exactly."""


@checked()
def find_sparse_forces(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    selection: AbstractSelection | None = None,
) -> xr.Dataset:
    r"""Find sparse unknown forces, and the states, from all of a recording.

    The moving window must decide on a force while it is in the window. After the measurement every
    force may be judged by all samples that it has moved, and choices that are too expensive for a
    window can be made: exact numbers of forces instead of the l1 norm, and sizes without its bias.

    Models need not be linear (eq. 9-10): the equations are linearised along a motion, from rest on,
    forces and motion found exactly for these, and again along the motion found (Gauss-Newton),
    until it stays. So parameters may be states of the model, such as with `augment`, and are found
    together with the forces.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        For what is known of noise, prior and forces: `noise`, `prior`, `forces`, `sigma_force`,
        `dictionary`, `nonnegative`, `nonpositive`, `hold`; and for `lam` and `threshold`. All that
        is about windows is not used.
    model : Model
    recording : xarray.Dataset
        ``NaN`` in an output is "not measured"; samples may have a noise of their own.
    selection : L1, Reweighted, Greedy or Given, optional
        How the atoms are chosen; `Greedy()` if not given.

    Returns
    -------
    xarray.Dataset
        A result as of `estimate`, with ``d_hat``, ``d_std (time, force)``. States are smoothed:
        every row is from all samples, and ``P`` contains how uncertain the forces are, their places
        and moments taken as right. ``e, S`` are those of a Kalman filter that knows the forces.
        Attributes ``nonzeros``, ``chi2``, the sum of the squared white innovations, ``measured``,
        their number, and ``passes``, how often the model was linearised.

    Warns
    -----
    BacksightWarning
        If the linearisations of a nonlinear model do not settle.

    Raises
    ------
    TuningError, ModelError
        If estimator and model do not fit.
    DataError
        If recording and model do not fit, or the problem would not fit into memory: it takes
        ``16 ny nf n**2`` bytes for n samples.

    Examples
    --------
    >>> find, greedy = bs.forces.find_sparse_forces, bs.forces.Greedy()
    >>> found = find(method, beam, recording, selection=greedy)  # doctest: +SKIP
    """
    started = time.perf_counter()
    chosen = selection or Greedy()
    if is_linear(model):
        search = prepared(estimator, model, recording)
        fit, passes = chosen.select(search), 1
    else:
        search, fit, passes = _gauss_newton(estimator, model, recording, chosen)
    result = as_result(
        _outputs(search, fit),
        _channels(search),
        estimator,
        model,
        recording,
        engine="numpy",
        seconds=time.perf_counter() - started,
    )
    measured = int((search.filter.mask > 0).sum())
    result.attrs |= {"nonzeros": len(fit.which), "chi2": fit.cost, "measured": measured}
    result.attrs["passes"] = passes
    return result


def prepared(estimator: AbstractForceEstimator, model: Model, recording: xr.Dataset) -> ForceSearch:
    """Check estimator, model and recording, and make the regression of `find_sparse_forces`."""
    data = match(model, recording, estimator=estimator)
    forced = estimator.forced(model, float(recording.attrs["dt"]))
    return _search(estimator, forced, data)


def _search(
    estimator: AbstractForceEstimator,
    forced: Forced,
    data: tuple[Array, Array, Array],
    matrices: MatricesInTime | None = None,
) -> ForceSearch:
    return force_search(
        forced,
        data,
        shapes=estimator.dictionary.shapes(len(estimator.forces)),
        side=estimator.sides(),
        lam=estimator.lam,
        threshold=estimator.threshold,
        matrices=matrices,
    )


def _gauss_newton(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    selection: AbstractSelection,
) -> tuple[ForceSearch, Fit, int]:
    """Linearise along a motion, find forces and the motion exactly, and again: how often, too."""
    data = match(model, recording, estimator=estimator)
    forced = estimator.linearised(model, float(recording.attrs["dt"]))
    u = data[0] / forced.system.s.su[: forced.nu]
    x, d = free_motion(forced, u), np.zeros((len(u), len(forced.names)))
    for passes in range(1, PASSES + 1):
        matrices = matrices_along(forced, x, u, d)
        search = _search(estimator, forced, data, matrices)
        fit = selection.select(search)
        d = search.forces(fit.which, fit.values)
        before, x = x, search.filter.smoothed(d)[0]
        spread = np.sqrt(np.einsum("kii->ki", search.filter.P))
        if (np.abs(x - before) <= SETTLED * spread + TINY).all():
            return search, fit, passes
    warnings.warn(
        f"the forces found with model '{model.name}' still change after {PASSES} linearisations; "
        "the result is the last one: start from a narrower prior, or look for fewer forces",
        BacksightWarning,
        stacklevel=4,
    )
    return search, fit, passes


def _channels(search: ForceSearch) -> tuple[Channel, ...]:
    """Names of the outputs."""
    names = search.filter.forced.names
    forces = (Channel(n, ("force",), labels=names) for n in ("d_hat", "d_std"))
    return (*ESTIMATE_CHANNELS, *forces)


def _outputs(search: ForceSearch, fit: Fit) -> list[Array]:
    """Outputs of the channels of `_channels`, (n, length) each, physical."""
    f = search.filter
    s = f.forced.system.s
    pulses = search.pulses(fit.which)
    d = pulses @ fit.values
    x, e = f.smoothed(d)
    moved = f.moved(pulses)
    P = f.smoothed_covariance() + moved @ fit.covariance @ moved.transpose(0, 2, 1)
    variance = np.einsum("kfi,ij,kfj->kf", pulses, fit.covariance, pulses)
    y = f.outputs(x, d)
    return [
        x * s.sx,
        _lower(P * np.outer(s.sx, s.sx)),
        y * s.sy,
        e * s.sy,
        _lower(f.S * np.outer(s.sy, s.sy)),
        np.zeros((len(x), 1)),
        d,
        np.sqrt(variance),
    ]


def _lower(P: Array) -> Array:
    """Lower triangles of matrices (n, m, m), column by column."""
    rows, columns = np.triu_indices(P.shape[1])
    return P[:, rows, columns]
