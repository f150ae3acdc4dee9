"""A recording with hits as a task that is checked first and carried out later."""

import dataclasses
import time
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from backsight.analysis.forces import with_fitted_hits
from backsight.engine.recursion import Channel
from backsight.errors import TuningError, nearest
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.dictionaries import AbstractPulses
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.estimation import as_result, match
from backsight.run.following._table import followed_hits
from backsight.sparse.nonlinear import (
    FollowedMotion,
    ForcedMotion,
    FoundHit,
    Offered,
    Readings,
    Watch,
    follower,
    readings_of,
)
from backsight.types import Array

LADDER = 2.0
"""Factor from one size that is tried to the next."""


@dataclasses.dataclass(frozen=True)
class FollowingTask:
    """What `follow_hits` does, checked and ready.

    Parameters
    ----------
    estimator, model, recording
    motion : ForcedMotion
    data : Readings
    watch : Watch
    course : AbstractPulses
    """

    estimator: AbstractForceEstimator
    model: Model
    recording: xr.Dataset
    motion: ForcedMotion
    data: Readings
    watch: Watch
    course: AbstractPulses

    @property
    def samples(self) -> int:
        """Number of samples of the recording."""
        return len(self.data.y)

    @property
    def numbers(self) -> int:
        """Numbers that are needed for a sample of the result."""
        nx, ny, nf = self.model.nx, self.model.ny, len(self.estimator.forces)
        return 4 * nx + 3 * ny + 5 * ny**2 + 4 * nf

    def follow(self, progress: Callable[[int], None]) -> FollowedMotion:
        """To the end of the recording; `progress` is told the number of samples done."""
        return follower(self.motion, self.data, self.watch, progress=progress)

    def table(self, hits: Sequence[FoundHit]) -> xr.Dataset:
        """The hits as `follow_hits` returns them."""
        names = self.estimator.forces
        return followed_hits(
            hits,
            self.course,
            names,
            [names[i] for i in self.watch.beside],
            begin=float(self.recording["time"].values[0]),
            dt=float(self.recording.attrs["dt"]),
        )


def ready_to_follow(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    sizes: tuple[float, float],
    before: int,
    after: int,
    beside: tuple[str, ...],
    alarm: float,
    gain: float,
) -> FollowingTask:
    """Check everything, see `follow_hits`."""
    course = estimator.dictionary
    if not isinstance(course, AbstractPulses):
        raise TuningError(
            f"hits are followed with a dictionary of pulses, such as HalfSines, not {course!r}"
        )
    moved, places = _parted(estimator.forces, beside)
    data = match(model, recording, estimator=estimator)
    forced = estimator.linearised(model, float(recording.attrs["dt"]))
    sign = {i: side for i, side in enumerate(_signs(estimator)) if side}
    low, high = min(sizes), max(sizes)
    ladder = np.geomspace(low, high, 1 + int(np.ceil(np.log(high / low) / np.log(LADDER))))
    watch = Watch(
        Offered(places, ladder, sign, first=0.0, last=0.0),
        course,
        moved,
        before=before,
        after=after,
        alarm=alarm,
        gain=gain,
    )
    motion = ForcedMotion.of(forced)
    return FollowingTask(
        estimator, model, recording, motion, readings_of(forced, data), watch, course
    )


def carry_out_following(task: FollowingTask, *, progress: Callable[[int], None]) -> xr.Dataset:
    """A result as of `estimate` with the hits in it.

    Between the hits states are those of the filter; over the window of a hit they are fitted to all
    of it, and ``e`` is what is left. ``d_hat, d_std (time, force)`` have the places of hits;
    ``hit_<name>`` are the columns of the table of `follow_hits`.
    """
    started = time.perf_counter()
    found = task.follow(progress)
    outputs, channels = _outputs(task, found)
    result = as_result(
        outputs,
        channels,
        task.estimator,
        task.model,
        task.recording,
        engine="numpy",
        seconds=time.perf_counter() - started,
    )
    return with_fitted_hits(result, task.table(found.hits))


def _outputs(task: FollowingTask, found: FollowedMotion) -> tuple[list[Array], list[Channel]]:
    """Outputs (n, length) and what they are, physical."""
    s, forced = task.motion.forced.system.s, task.motion.forced
    v = task.motion.inputs(task.data.u, found.d)
    rows, columns = np.triu_indices(len(s.sy))
    places = list(task.watch.offered.forces)
    values = {
        "x_hat": found.x * s.sx,
        "x_std": np.sqrt(np.maximum(found.spread, 0.0)) * s.sx,
        "y_hat": task.motion.outputs(found.x, v) * s.sy,
        "e": found.e * s.sy,
        "S": (found.S * np.outer(s.sy, s.sy))[:, rows, columns],
        "status": np.zeros((len(found.x), 1)),
        "d_hat": found.d[:, places],
        "d_std": np.sqrt(np.maximum(found.d_spread, 0.0))[:, places],
    }
    names = tuple(forced.names[i] for i in places)
    forces = (Channel(n, ("force",), labels=names) for n in ("d_hat", "d_std"))
    known = {c.name: c for c in (*ESTIMATE_CHANNELS, Channel("x_std", ("state",)), *forces)}
    return list(values.values()), [known[name] for name in values]


def _parted(
    forces: Sequence[str], beside: Sequence[str]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Numbers of the forces beside a hit, and of those at which it may be."""
    for name in beside:
        if name not in forces:
            raise TuningError(f"beside: '{name}' is none of the forces: {nearest(name, forces)}")
    places = tuple(i for i, name in enumerate(forces) if name not in beside)
    if not places:
        raise TuningError("beside: all forces are beside the hit; leave one out")
    return tuple(forces.index(name) for name in beside), places


def _signs(estimator: AbstractForceEstimator) -> list[float]:
    """1, -1 or 0 of every force."""
    side, belongs = estimator.sides(), estimator.dictionary.force_of(len(estimator.forces))
    return [float(side[belongs.index(i)]) for i in range(len(estimator.forces))]
