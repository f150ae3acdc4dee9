"""Study of a beam under hammer blows: where, when and how hard, without the hammer's signal."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.frame_hammer.experiment import Progress, carry_out
from backsight_studies.frame_hammer.figures import draw
from backsight_studies.frame_hammer.page import TITLE, build, short
from backsight_studies.frame_hammer.tables import write_tables
from backsight_studies.frame_hammer.verdicts import checks
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
        Simulated recordings of every height.
    recordings : sequence of path
        Further measured ones, NumPy files as described in `source.read`; the two of the data set
        are taken from the folder that the environment variable BACKSIGHT_DATA names.
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
        If there is no recording, or one cannot be read or is not one of this rig.
    OutputError
        If the folder cannot be written.
    """

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, recordings, progress)
        found = checks(experiment)
        write_tables(experiment, folder)
        figures = draw(experiment, folder)
        return Written(found, build(experiment, found, figures), short(experiment, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("frame_hammer", TITLE, run)
