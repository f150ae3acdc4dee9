"""Sparse forces of a whole recording as a task that is checked first and carried out later."""

import dataclasses
import time
from collections.abc import Callable

import xarray as xr

from backsight.analysis.forces import with_fitted_hits
from backsight.errors import TuningError
from backsight.estimators.dictionaries import ForceLine, MovingLoads
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.lti import is_linear
from backsight.models.model import Model
from backsight.run.estimation import match
from backsight.run.hits import locate_hits
from backsight.run.sparse_forces import find_sparse_forces
from backsight.sparse import AbstractSelection


@dataclasses.dataclass(frozen=True)
class SearchTask:
    """What `find_sparse_forces` does, and `locate_hits` after it.

    Parameters
    ----------
    estimator, model, recording
    selection : AbstractSelection, optional
    locates : bool
        Whether hits are then located between places and samples.
    line : ForceLine, optional
        Where the places are.
    """

    estimator: AbstractForceEstimator
    model: Model
    recording: xr.Dataset
    selection: AbstractSelection | None
    locates: bool
    line: ForceLine | None

    @property
    def samples(self) -> int:
        """Number of samples of the recording."""
        return self.recording.sizes["time"]

    @property
    def numbers(self) -> int:
        """Numbers that are needed for a sample of the result."""
        nx, ny, nf = self.model.nx, self.model.ny, len(self.estimator.forces)
        return 3 * nx * nx + 3 * ny * ny + 4 * (nx + ny + nf)


def ready_to_search(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    selection: AbstractSelection | None,
    locates: bool,
    line: ForceLine | None,
) -> SearchTask:
    """Check what can be checked before forces are looked for."""
    match(model, recording, estimator=estimator)
    dt = float(recording.attrs["dt"])
    linear = is_linear(model)
    (estimator.forced if linear else estimator.linearised)(model, dt)
    if locates and not linear:
        raise TuningError(
            "hits are located between the places of linear models; leave out locate, or follow them"
        )
    if locates and line is None and not isinstance(estimator.dictionary, MovingLoads):
        raise TuningError("locate needs a line that says where the places are: line.places")
    if line is not None:
        line.check(len(estimator.forces))
    return SearchTask(estimator, model, recording, selection, locates, line)


def carry_out_search(task: SearchTask, *, progress: Callable[[int], None]) -> xr.Dataset:
    """A result as of `find_sparse_forces`, with the columns of `locate_hits` as ``hit_<name>``."""
    started = time.perf_counter()
    result = find_sparse_forces(
        task.estimator, task.model, task.recording, selection=task.selection
    )
    if task.locates and result["d_hat"].values.any():
        hits = locate_hits(task.estimator, task.model, task.recording, result, line=task.line)
        result = with_fitted_hits(result, hits)
        result.attrs["seconds"] = time.perf_counter() - started
    progress(task.samples)
    return result
