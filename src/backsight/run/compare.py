"""Run several estimators over the same recording."""

import dataclasses
import functools
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias

import xarray as xr

from backsight.analysis.comparison import ranked_table, units, verdicts
from backsight.description import Printed, checked
from backsight.engine.execute import Engine
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run._ranking import (
    as_text,
    final_values,
    hits_table,
    ranking,
    true_errors,
    virtual_values,
)
from backsight.run.diagnosis import audited
from backsight.run.estimation import (
    SmoothingTask,
    Task,
    carry_out,
    carry_out_smoothing,
    check_memory,
    ready,
)
from backsight.run.following import FollowingTask, carry_out_following
from backsight.run.searched import SearchTask, carry_out_search

AnyTask: TypeAlias = Task | SmoothingTask | FollowingTask | SearchTask
"""An estimator made ready for a recording, and what it is to do with it."""


@dataclasses.dataclass(frozen=True)
class Comparison(Printed, Mapping[str, xr.Dataset]):
    """Results by name; prints itself as a ranked table.

    Parameters
    ----------
    results : dict
        Name to result dataset.
    """

    results: Mapping[str, xr.Dataset]

    def __getitem__(self, name: str) -> xr.Dataset:
        return self.results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)

    def __str__(self) -> str:
        said = (textwrap.fill(s, 80, subsequent_indent="  ") for s in self.verdicts())
        return "\n".join([self.table(), "", *said])

    def __repr__(self) -> str:
        return f"Comparison of {', '.join(map(repr, self.results))}"

    def table(self, reference: Mapping[str, float] | None = None, *, width: int = 80) -> str:
        """Return the ranking, the final values and the errors against the truth as text.

        Parameters
        ----------
        reference : dict, optional
            Known value of some states [their units]; adds errors.
        width : int
            Columns of the page.
        """
        rows = ranked_table(self.results, reference)
        outputs = units(next(iter(self.results.values())), "output")
        tables = [ranking(rows, outputs), final_values(rows)]
        if any(not math.isnan(e) for row in rows for e in row.rms_error.values()):
            tables.append(true_errors(rows))
        if any(row.virtual for row in rows):
            tables.append(virtual_values(rows))
        tables += [hits_table(row) for row in rows if row.fitted_hits]
        return as_text(tables, width)

    def verdicts(self, reference: Mapping[str, float] | None = None) -> list[str]:
        """Return what the tables mean, in a few sentences; arguments as in `table`."""
        return verdicts(ranked_table(self.results, reference))


@checked()
def compare(
    estimators: Mapping[str, AbstractEstimator],
    model: Model,
    recording: xr.Dataset,
    *,
    engine: Engine | None = None,
    throw: bool = True,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Comparison:
    """Run estimators over the same recording and rank them.

    Parameters
    ----------
    estimators : dict
        Name (free to choose) to estimator.
    model, recording, engine, throw
        As in `estimate`.
    progress : callable
        Told the name of the estimator at work and the number of samples done.

    Returns
    -------
    Comparison
        A mapping from name to result. The results also say whether outputs and inputs are aligned
        and by how much the noise is off, see `backsight.run.diagnosis.audit`.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0)
    >>> filters = {"KF": bs.KalmanFilter(noise, prior), "EKF": bs.EKF(noise, prior)}
    >>> list(bs.compare(filters, spring, recording, engine="vm"))
    ['KF', 'EKF']
    """
    if not estimators:
        raise TuningError("there is no estimator to compare")
    tasks = {name: ready(e, model, recording) for name, e in estimators.items()}
    return compared(tasks, engine=engine, throw=throw, progress=progress)


def compared(
    tasks: Mapping[str, AnyTask],
    *,
    engine: Engine | None = None,
    throw: bool = True,
    progress: Callable[[str, int], None] = lambda *_: None,
    interrupted: Callable[[Sequence[str]], None] | None = None,
) -> Comparison:
    """Run what is ready, see `compare`: estimators of one model over one recording.

    An interrupt ends it. If `interrupted` is given and an estimator has finished, it is told the
    names of those that have not, and the comparison is that of the others.
    """
    samples = next(iter(tasks.values())).samples
    check_memory([task.numbers for task in tasks.values()], samples)
    results = {}
    for name, task in tasks.items():
        told = functools.partial(progress, name)
        told(0)
        try:
            match task:
                case SmoothingTask():
                    found = carry_out_smoothing(task, engine=engine, throw=throw, progress=told)
                case FollowingTask():
                    found = carry_out_following(task, progress=told)
                case SearchTask():
                    found = carry_out_search(task, progress=told)
                case Task():
                    found = carry_out(task, engine=engine, throw=throw, progress=told)
        except KeyboardInterrupt:
            if interrupted is None or not results:
                raise
            interrupted([other for other in tasks if other not in results])
            break
        results[name] = found
    estimators = {name: tasks[name].estimator for name in results}
    first = next(iter(tasks.values()))
    return Comparison(audited(results, estimators, first.model, first.recording))
