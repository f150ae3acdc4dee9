"""Study of the arrival costs of moving horizon estimation."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight.errors import DataError
from backsight_studies.arrival.expected import checks
from backsight_studies.arrival.experiment import Progress, carry_out
from backsight_studies.arrival.figures import draw
from backsight_studies.arrival.page import TITLE, build, short
from backsight_studies.arrival.tables import write_tables
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, publish

SEEDS = 50
"""Recordings of every simulated plant."""


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = tuple(range(SEEDS)),
    recordings: Sequence[str | os.PathLike[str]] = (),
    progress: Progress = lambda _what, _share: None,
    force: bool = False,
) -> Findings:
    """Carry out the study and write its page, tables, figures and ``checks.json``.

    Parameters
    ----------
    out : path
        Folder for the results; made if it does not exist.
    seeds : sequence of int
        Of the simulated recordings.
    recordings : sequence of path
        Must be empty: measured machines are found by the variable ``BACKSIGHT_DATA``.
    progress : callable
        Told what is being done and the share of the work that is done.
    force : bool
        Replace files in the folder that are not from an earlier run.

    Returns
    -------
    Findings

    Raises
    ------
    DataError
        If there is no seed, one is negative, or a recording is given.
    OutputError
        If the folder cannot be written.
    """
    if recordings:
        raise DataError("the study of arrival costs simulates its plants and takes no recordings")

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, progress)
        found = checks(experiment)
        write_tables(experiment, folder)
        figures = draw(experiment, folder)
        return Written(found, build(experiment, found, figures), short(experiment, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("arrival", TITLE, run, seeds=SEEDS)
