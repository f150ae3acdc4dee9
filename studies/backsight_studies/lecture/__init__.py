"""Study of the lecture on least-squares moving horizon estimation: gains, forms, limits."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from backsight.errors import DataError
from backsight_studies.lecture.experiment import carry_out
from backsight_studies.lecture.figures import draw
from backsight_studies.lecture.page import TITLE, build, short
from backsight_studies.lecture.verdicts import checks
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, publish


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = (0,),
    recordings: Sequence[str | os.PathLike[str]] = (),
    progress: Callable[[str, float], None] = lambda _what, _share: None,
    force: bool = False,
) -> Findings:
    """Carry out the study and write its page, figures and ``checks.json``.

    Parameters
    ----------
    out : path
        Folder for the results; made if it does not exist.
    seeds : sequence of int
        The first one is that of the simulated motions.
    recordings : sequence of path
        Must be empty: the study is about simulated plants.
    progress : callable
        Told what is being done and the share of the work that is done.
    force : bool
        Replace files in the folder that are not from an earlier run.

    Raises
    ------
    DataError
        If recordings are given, or no seed or a negative one.
    OutputError
        If the folder cannot be written.
    """
    if recordings:
        raise DataError("this study takes no recordings: its plants are simulated")
    if not seeds or seeds[0] < 0:
        raise DataError("the study needs one seed that is not negative")

    def work(folder: Path) -> Written:
        progress("simulating and estimating", 0.0)
        experiment = carry_out(seeds[0])
        progress("checking", 0.8)
        found = checks(experiment)
        page = build(experiment, found, draw(experiment, folder))
        progress("", 1.0)
        return Written(found, page, short(experiment, found))

    return publish(out, TITLE, work=work, force=force)


STUDY = Study("lecture", TITLE, run)
