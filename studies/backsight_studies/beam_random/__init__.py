"""Study of randomly struck beams: the paper's method beside its extensions."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.beam_random.experiment import Experiment, Progress, carry_out
from backsight_studies.beam_random.figures import draw
from backsight_studies.beam_random.page import FIELDS, TITLE, build, short
from backsight_studies.beam_random.verdicts import checks
from backsight_studies.sheets import write_sheet
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, check_simulated, publish

SCENARIOS = 50


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = range(SCENARIOS),
    recordings: Sequence[str | os.PathLike[str]] = (),
    progress: Progress = lambda _what, _share: None,
    force: bool = False,
) -> Findings:
    """Carry out the study and write its page, tables, figures and ``checks.json``.

    It starts one process per core; a program that calls this needs the usual
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    out : path
        Folder for the results; made if it does not exist.
    seeds : sequence of int
        One for each scenario.
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
        found = checks(experiment)
        write_sheet(folder / "methods.csv", *_sheet(experiment))
        page = build(experiment, found, draw(experiment, folder))
        progress("", 1.0)
        return Written(found, page, short(experiment, found))

    return publish(out, TITLE, work=work, force=force)


def _sheet(e: Experiment) -> tuple[list[str], list[list[object]]]:
    rows: list[list[object]] = [
        [method, m, *(e.mean(method, m, field) for field in FIELDS)] for method, m in e.outcomes
    ]
    return ["method", "mismatch_percent", *FIELDS], rows


STUDY = Study("beam_random", TITLE, run, seeds=SCENARIOS)
