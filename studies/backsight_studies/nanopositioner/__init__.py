"""Study of Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012): moving horizon observer against EKF."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.nanopositioner.claims import judge
from backsight_studies.nanopositioner.expected import checks
from backsight_studies.nanopositioner.experiment import Progress, carry_out
from backsight_studies.nanopositioner.figures import draw
from backsight_studies.nanopositioner.page import TITLE, build, short
from backsight_studies.nanopositioner.tables import write_tables
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, publish


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
        Simulated recordings of every scenario.
    recordings : sequence of path
        Files in the form of `plant.read_recording`, judged in the same way.
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
        If there is nothing to do or a recording cannot be used.
    OutputError
        If the folder cannot be written.
    """

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, recordings, progress)
        verdicts = judge(experiment)
        found = checks(experiment, verdicts)
        write_tables(experiment, verdicts, folder)
        page = build(experiment, verdicts, found, draw(experiment, folder))
        return Written(found, page, short(experiment, verdicts, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("nanopositioner", TITLE, run)
