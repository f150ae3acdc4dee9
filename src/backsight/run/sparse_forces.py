"""Sparse forces from a whole recording at once, after it has ended."""

import time

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine.recursion import Channel
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.estimation import as_result, match
from backsight.sparse import AbstractSelection, Fit, ForceSearch, Greedy, force_search
from backsight.types import Array


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
        Attributes ``nonzeros``, ``chi2``, the sum of the squared white innovations, and
        ``measured``, their number.

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
    search = prepared(estimator, model, recording)
    fit = (selection or Greedy()).select(search)
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
    return result


def prepared(estimator: AbstractForceEstimator, model: Model, recording: xr.Dataset) -> ForceSearch:
    """Check estimator, model and recording, and make the regression of `find_sparse_forces`."""
    data = match(model, recording, estimator=estimator)
    forced = estimator.forced(model, float(recording.attrs["dt"]))
    return force_search(
        forced,
        data,
        shapes=estimator.dictionary.shapes(len(estimator.forces)),
        side=estimator.sides(),
        lam=estimator.lam,
        threshold=estimator.threshold,
    )


def _channels(search: ForceSearch) -> tuple[Channel, ...]:
    """Names of the outputs."""
    names = search.filter.forced.names
    forces = (Channel(n, ("force",), labels=names) for n in ("d_hat", "d_std"))
    return (*ESTIMATE_CHANNELS, *forces)


def _outputs(search: ForceSearch, fit: Fit) -> list[Array]:
    """Outputs of the channels of `_channels`, (n, length) each, physical."""
    f = search.filter
    m, s = f.motion, f.forced.system.s
    pulses = search.pulses(fit.which)
    d = pulses @ fit.values
    x, e = f.smoothed(d)
    moved = f.moved(pulses)
    P = f.smoothed_covariance() + moved @ fit.covariance @ moved.transpose(0, 2, 1)
    variance = np.einsum("kfi,ij,kfj->kf", pulses, fit.covariance, pulses)
    y = np.einsum("kij,kj->ki", m.C, x) + m.seen + np.einsum("kij,kj->ki", m.F, d)
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
