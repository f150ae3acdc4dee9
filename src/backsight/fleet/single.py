"""One recording of a fleet with its setting, as the problem that it is."""

import dataclasses
from pathlib import Path

from backsight.errors import ProblemError
from backsight.fleet._work import problem_with, said_with
from backsight.fleet.store import reading_store
from backsight.problem.problem import Problem


def problem_of_item(store: str | Path, item: str) -> Problem:
    """The problem of a row, with the recording and the values that it was made of.

    Parameters
    ----------
    store : path
        Folder of `run_fleet`.
    item : str
        As the table has it.

    Raises
    ------
    DataError
        If the folder is not that of a fleet.
    ProblemError
        If there is no such item, or the problem can no longer be read.
    """
    with reading_store(Path(store)) as opened:
        about, entry = opened.about, opened.entry(item)
    if entry is None:
        raise ProblemError(f"'{store}' has no item '{item}'; the table of the fleet names them")
    recording, setting = entry
    changes = (*setting.items(), *recording["changes"].items())
    problem = problem_with(about["text"], about["problem"], changes, recording["path"])
    return dataclasses.replace(
        problem,
        title=f"{about['title']}: {recording['name']}",
        text=said_with((("recording.path", recording["path"]), *changes), problem.text),
        report=True,
    )
