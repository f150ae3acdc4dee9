"""Write what a study found: all of it, or nothing."""

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from backsight.errors import DataError
from backsight.output import whole, write_whole
from backsight_studies.checks import Check, write_checks
from backsight_studies.study import Findings

PAGE = "study.html"


@dataclasses.dataclass(frozen=True)
class Written:
    """What is left to write when the tables and figures of a study are in its folder.

    Parameters
    ----------
    checks : sequence of Check
    page : str
        HTML.
    points : sequence of str
        The study in a few sentences.
    """

    checks: Sequence[Check]
    page: str
    points: Sequence[str]


def publish(
    out: str | os.PathLike[str],
    title: str,
    *,
    work: Callable[[Path], Written],
    force: bool = False,
) -> Findings:
    """Carry a study out and write its page and ``checks.json`` beside what it wrote itself.

    Parameters
    ----------
    out : path
        Folder for the results; made if it does not exist, and as it was if anything fails.
    title : str
    work : callable
        Carries the study out; given a folder, writes tables and figures there.
    force : bool
        Replace files in the folder that are not from an earlier run.

    Raises
    ------
    OutputError
        If the folder cannot be written, or there is anything in it but the results of an earlier
        run.
    """
    with whole(out, force=force) as folder:
        written = work(folder)
        write_checks(folder / "checks.json", written.checks)
        write_whole(folder / PAGE, written.page.encode())
    lines = [title, *(f"- {point}" for point in written.points)]
    return Findings(Path(out) / PAGE, tuple(written.checks), "\n".join(lines))


def check_simulated(what: str, *, seeds: Sequence[int], recordings: Sequence[object]) -> None:
    """Raise `DataError` if there is a recording, no seed, or a negative one."""
    if recordings:
        raise DataError(f"the study of the {what} is a simulation and takes no recordings")
    if not seeds or min(seeds) < 0:
        raise DataError(f"the study of the {what} needs a seed, and none may be negative")
