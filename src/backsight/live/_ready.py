"""What a run needs before its first sample, and what a second run of the same file can take over.

A run that was killed begins again with all of this at hand (`backsight.live._reviving`): machine
code, and the ports that are listened on, at which datagrams wait meanwhile.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

from backsight.engine.dense import UNROLL
from backsight.engine.execute import Engine, prepare
from backsight.errors import ProblemError
from backsight.live._freezing import Freezable, freezable
from backsight.live._problem import LiveProblem
from backsight.live.sources import LiveSource, source_of
from backsight.live.store import arrow
from backsight.problem.reading.tables import FeedTable, ReplayFeed
from backsight.run.estimation import Outputs, Prepared, compile_once
from backsight.run.estimation.results.outputs import JUDGED

if TYPE_CHECKING:
    import xarray as xr

SHOWN = (*JUDGED, "z_hat", "z_std", "d_hat", "d_std", "weight")
"""Variables that are kept of every sample, where the estimator has them."""


@dataclasses.dataclass(frozen=True)
class ReadyRun:
    """A run before its first sample, see `made_ready`.

    Parameters
    ----------
    live : LiveProblem
        With walks that can be switched off, if that is asked for.
    dt : float
        Sampling period [s].
    engine : {"native", "vm"}
    varied : Freezable, optional
        What can be frozen.
    prepared : Prepared
    sources : tuple of LiveSource
        Opened, but not started.
    """

    live: LiveProblem
    dt: float
    engine: Engine
    varied: Freezable | None
    prepared: Prepared
    sources: tuple[LiveSource, ...]


def made_ready(live: LiveProblem, *, engine: Engine = "native") -> ReadyRun:
    """Compile the estimator and open the sources.

    Raises
    ------
    ProblemError, DataError
        If something that is needed is missing.
    OutputError
        If a port is taken.
    PluginError
        If a package is not installed.
    """
    dt = _period(live)
    live, varied = _with_freezing(live, dt)
    prepared = compiled_live(live, dt)
    prepare(prepared.recursion, engine)
    if live.store is not None:
        arrow()
    sources: list[LiveSource] = []
    try:
        for name, feed in live.feeds.items():
            sources.append(source_of(name, feed, functools.partial(_replayed, live, feed)))
            sources[-1].open()
    except BaseException:
        for source in sources:
            source.stop()
        raise
    return ReadyRun(live, dt, engine, varied, prepared, tuple(sources))


def compiled_live(live: LiveProblem, dt: float) -> Prepared:
    """The estimator as it runs: what is shown of it, and begun anew when it diverges."""
    needed = (*SHOWN, "S") if live.model.ny <= UNROLL else SHOWN
    return compile_once(
        live.estimator, live.model, dt, outputs=Outputs(("x_std",)), restart=True, needed=needed
    )


def _with_freezing(live: LiveProblem, dt: float) -> tuple[LiveProblem, Freezable | None]:
    """The problem with random walks that can be switched off, if that is asked for."""
    if live.settings.freeze is None:
        return live, None
    varied = freezable(live.estimator, live.model, dt, parameters=live.parameters)
    problem = dataclasses.replace(
        live.problem,
        model=varied.model,
        estimators={**live.problem.estimators, live.estimator_name: varied.estimator},
    )
    return dataclasses.replace(live, problem=problem), varied


def _period(live: LiveProblem) -> float:
    if live.settings.dt is not None:
        return live.settings.dt
    for feed in live.feeds.values():
        if isinstance(feed, ReplayFeed):
            return float(_replayed(live, feed).attrs["dt"])
    raise ProblemError("live.dt: is missing; give the sampling period [s] of the estimator")


def _replayed(live: LiveProblem, feed: FeedTable) -> xr.Dataset:
    from backsight.problem.recorded import recording_of

    if not isinstance(feed, ReplayFeed) or not feed.path:
        return recording_of(live.problem)
    return recording_of(dataclasses.replace(live.problem, recording=feed.as_recording))
