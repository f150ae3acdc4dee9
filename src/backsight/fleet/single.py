"""One recording of a fleet with its setting, as the problem that it is."""

import dataclasses
from pathlib import Path

from backsight.errors import ProblemError
from backsight.fleet.items import problem_with, said_with
from backsight.fleet.rows import reading_store
from backsight.problem.problem import Problem


def problem_of_item(store: str | Path, item: str) -> Problem:
    r"""The problem of a row, with the recording and the values that it was made of.

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
    >>> _ = bs.fleet.run_fleet(bs.fleet.load_fleet("fleet.toml"), "store", workers=0)
    >>> item = bs.fleet.read_rows("store")["item"][0]
    >>> bs.fleet.problem_of_item("store", item).title
    'fleet: run_1.csv'
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
