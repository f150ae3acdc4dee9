"""Study of Kirchner, Croes, Cosco, Desmet: where, when and how hard a beam was hit."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight.errors import DataError
from backsight.output import whole, write_whole
from backsight.studies.beam.claims import judge
from backsight.studies.beam.experiment import Progress, carry_out
from backsight.studies.beam.figures import draw
from backsight.studies.beam.page import TITLE, build, short
from backsight.studies.beam.tables import write_tables
from backsight.studies.beam.verdicts import checks
from backsight.studies.checks import write_checks
from backsight.studies.study import Findings, Study

PAGE = "study.html"


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = (0, 1, 2),
    recordings: Sequence[str | os.PathLike[str]] = (),
    progress: Progress = lambda _what, _share: None,
) -> Findings:
    """Carry out the study and write its page, tables, figures and ``checks.json``.

    Parameters
    ----------
    out : path
        Folder for the results; made if it does not exist.
    seeds : sequence of int
        Of the sensor noise.
    recordings : sequence of path
        Must be empty: this study knows its beam and simulates it.
    progress : callable
        Told what is being done and the share of the work that is done.

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
        raise DataError("the study of the beam is a simulation and takes no recordings")
    if not seeds or min(seeds) < 0:
        raise DataError("the study of the beam needs a seed, and none may be negative")
    with whole(out) as folder:
        experiment = carry_out(seeds, progress)
        claims = judge(experiment)
        found = checks(experiment, claims)
        write_tables(experiment, claims, folder)
        write_checks(folder / "checks.json", found)
        figures = draw(experiment, folder)
        write_whole(folder / PAGE, build(experiment, claims, found, figures).encode())
        progress("", 1.0)
    lines = [f"- {point}" for point in short(experiment, claims, found)]
    return Findings(Path(out) / PAGE, tuple(found), "\n".join([TITLE, *lines]))


STUDY = Study("beam", TITLE, run)
