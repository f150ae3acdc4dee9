"""Run a fleet: hand out what is missing, land what comes back."""

import contextlib
import dataclasses
import os
from collections.abc import Callable, Collection
from pathlib import Path

from backsight.errors import OutputError
from backsight.fleet._plan import FleetPlan, Order, catalogued, missing_of, told_of
from backsight.fleet._workers import Answer, Workers, workers_of
from backsight.fleet.fleet import Fleet
from backsight.fleet.items import Work
from backsight.fleet.rows import RESULTS, FleetStore, Landed, failed_row, opened_fleet_store

AHEAD = 2
"""Pieces of work for each worker: one to do, and one that is there when it is done."""


@dataclasses.dataclass(frozen=True)
class FleetRun:
    """What a run has done.

    Parameters
    ----------
    items : int
        Recordings times settings.
    before : int
        Of them, those that were done before.
    """

    items: int
    before: int


def run_fleet(
    fleet: Fleet,
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    outside: Collection[str] = (),
    env: Collection[str] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
    tell: Callable[[str], None] = lambda _: None,
) -> FleetRun:
    r"""Run the estimators of a fleet over all its recordings with all settings.

    Every recording with a setting becomes a row for each estimator, whole or not at all. What is
    in the folder already is not done again, unless its data have changed: a run that was
    interrupted, in whatever way, goes on when it is started again, and the rows are those that it
    would have had to the last bit. A recording that cannot be read, or on which an estimator
    fails, is a row with the reason.

    Parameters
    ----------
    fleet : Fleet
        From `load_fleet`.
    out : path
        Folder; missing ones are made. One with another fleet is refused.
    workers : int, optional
        Processes on this computer, one for each core by default; 0: this process alone. A script
        that starts some needs ``if __name__ == "__main__":``.
    scheduler : str, optional
        Address of a scheduler of dask.distributed, whose workers see the same files under the same
        paths.
    outside : collection of str
        Other files from which recordings may take measurements, see `backsight.read`.
    env : collection of str
        Environment variables that paths may use beside ``BACKSIGHT_DATA``.
    progress : callable
        Told the number of items done, and of all of them.
    tell : callable
        Told what is waited for.

    Returns
    -------
    FleetRun

    Raises
    ------
    OutputError
        If the folder cannot be written, holds something else, or another process writes to it.
        What was written stays.
    WorkerError
        If workers are missing, gone, or have another version.

    Examples
    --------
    >>> from pathlib import Path
    >>> spring = '''
    ... recording = { path = "-", time = "t", inputs.u = "F", outputs.y = "q" }
    ... model = { kind = "sdof", k = 40.0, b = 1.0 }
    ... noise.sigma_y.y = 1e-3
    ... estimators.KF.kind = "kf"
    ... prior.sigma_x0 = { q = 0.1, v = 0.1 }
    ... '''
    >>> _ = Path("spring.toml").write_text(spring)
    >>> _ = Path("run_1.csv").write_text("t,F,q\n0,1,0\n1,1,1\n")
    >>> _ = Path("fleet.toml").write_text('problem = "spring.toml"\nrecordings.files = "run*.csv"')
    >>> bs.fleet.run_fleet(bs.fleet.load_fleet("fleet.toml"), "store", workers=0)
    FleetRun(items=1, before=0)
    """
    folder = Path(out)
    problem = fleet.problem
    order = Order(
        text=problem.text,
        file=str(problem.path.absolute()),
        keep=fleet.keep,
        results=str((folder / RESULTS).absolute()),
        outside=tuple(outside),
        env=tuple(env),
    )
    with opened_fleet_store(folder, said=fleet.identity(), about=_about(fleet, order)) as store:
        store.catalogue(
            [told_of(listed) for listed in fleet.recordings],
            [dict(setting) for setting in fleet.settings],
            catalogued(fleet),
        )
        plan = FleetPlan(list(missing_of(fleet, store.known())), order)
        items = len(fleet.recordings) * len(fleet.settings)
        before = items - plan.left
        progress(before, items)
        if plan.left:
            with _counting(store), workers_of(workers, scheduler, tell) as crew:
                _carry_out(plan, crew, store, lambda done: progress(before + done, items))
    return FleetRun(items, before)


@contextlib.contextmanager
def _counting(store: FleetStore):
    """Say how much is missing when there is no room for more."""
    try:
        yield
    except OutputError as error:
        raise OutputError(
            f"{error}; {store.missing()} recordings with their settings are missing: start again "
            "with the same folder to go on"
        ) from None


def _carry_out(
    plan: FleetPlan, crew: Workers, store: FleetStore, progress: Callable[[int], None]
) -> None:
    landed = 0
    while True:
        slots = crew.slots  # workers come and go
        while crew.running < AHEAD * slots and (work := plan.next(slots)) is not None:
            crew.submit(work)
        if not crew.running:
            return
        # All that is there lands together: a landing waits for the disk, however many rows it has.
        found = [
            one for work, answer in crew.finished() for one in _outcome(work, answer, plan, crew)
        ]
        if found:
            store.land(found)
            landed += len(found)
            progress(landed)


def _outcome(work: Work, answer: Answer | str, plan: FleetPlan, crew: Workers) -> list[Landed]:
    """What can be landed; work that took its workers along is tried again one by one."""
    if not isinstance(answer, str):
        found, seconds = answer
        plan.learn(seconds)
        return found
    if len(work.pieces) > 1:
        for single in plan.alone(work):
            crew.submit(single)
        return []
    # Without a digest of the data: it is tried again by the next run.
    return [Landed(piece.item, "", (), {"": failed_row(answer)}) for piece in work.pieces]


def _about(fleet: Fleet, order: Order) -> dict[str, object]:
    model = fleet.problem.model
    return {
        "title": fleet.title,
        "fleet": str(fleet.path.absolute()),
        "problem": order.file,
        "text": order.text,
        "axes": [*fleet.axes],
        "estimators": [*fleet.problem.estimators],
        "reference": dict(fleet.problem.reference),
        "states": {s.name: s.unit for s in model.states},
        "unknown": [s.name for s in model.states if s.name in model.resting],
        "outputs": {s.name: s.unit for s in model.outputs},
    }
