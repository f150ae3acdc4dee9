"""Study of Kirchner, Croes, Cosco, Desmet: where, when and how hard a beam was hit."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.beam.claims import judge
from backsight_studies.beam.experiment import Progress, carry_out
from backsight_studies.beam.figures import draw
from backsight_studies.beam.page import TITLE, build, short
from backsight_studies.beam.tables import write_tables
from backsight_studies.beam.verdicts import checks
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, check_simulated, publish


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = (0, 1, 2),
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
        Of the sensor noise.
    recordings : sequence of path
        Must be empty: this study knows its beam and simulates it.
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
    check_simulated("beam", seeds=seeds, recordings=recordings)

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, progress)
        claims = judge(experiment)
        found = checks(experiment, claims)
        write_tables(experiment, claims, folder)
        page = build(experiment, claims, found, draw(experiment, folder))
        progress("", 1.0)
        return Written(found, page, short(experiment, claims, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("beam", TITLE, run)
