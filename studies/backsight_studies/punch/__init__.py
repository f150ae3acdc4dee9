"""Study of Riva, Dagen, Ortmaier: adaptive high-gain observer against EKF and UKF."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight.errors import DataError
from backsight_studies.punch.claims import judge
from backsight_studies.punch.expected import checks
from backsight_studies.punch.experiment import Progress, carry_out
from backsight_studies.punch.figures import draw
from backsight_studies.punch.page import TITLE, build, short
from backsight_studies.punch.tables import write_tables
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, publish


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = (0, 1, 2, 3, 4),
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
        Must be empty: this study knows its plant and simulates it.
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
        raise DataError("the study of the punch is a simulation and takes no recordings")

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, progress)
        claims = judge(experiment)
        found = checks(experiment, claims)
        write_tables(experiment, claims, folder)
        figures = draw(experiment, folder)
        return Written(found, build(experiment, claims, found, figures), short(claims, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("punch", TITLE, run)
