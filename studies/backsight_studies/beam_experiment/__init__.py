"""Study of the experiment of Kirchner, Croes, Cosco, Desmet: a hammer on a beam, simulated."""

import os
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.beam.plant import NODES
from backsight_studies.beam_experiment.experiment import Experiment, Progress, carry_out
from backsight_studies.beam_experiment.figures import draw
from backsight_studies.beam_experiment.page import TITLE, build, short
from backsight_studies.beam_experiment.verdicts import checks, judge
from backsight_studies.sheets import write_sheet
from backsight_studies.study import Findings, Study
from backsight_studies.writing import Written, check_simulated, publish

RECORDINGS = 10


def run(
    out: str | os.PathLike[str],
    *,
    seeds: Sequence[int] = range(RECORDINGS),
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
        Of the sensor noise, one for each recording.
    recordings : sequence of path
        Must be empty: the measured ones of the paper are not published.
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
    check_simulated("hammer", seeds=seeds, recordings=recordings)

    def work(folder: Path) -> Written:
        experiment = carry_out(seeds, progress)
        claims = judge(experiment)
        found = checks(experiment, claims)
        write_sheet(folder / "outputs.csv", *_sheet(experiment))
        page = build(experiment, claims, found, draw(experiment, folder))
        progress("", 1.0)
        return Written(found, page, short(experiment, claims, found))

    return publish(out, TITLE, work=work, force=force)


def _sheet(e: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["beam", "noise_m", "method", "recording", "step", "place_m", "force_N"]
    named = {(b, s, f"window, {r}"): e.output(b, s, r) for b, s, r in e.windows}
    named |= {(b, s, "l0"): found for (b, s), found in e.l0.items()}
    rows: list[list[object]] = []
    for key, outputs in named.items():
        for i, found in enumerate(outputs):
            for step, node in zip(*found.nonzero(), strict=True):
                rows.append([*key, i, int(step), NODES[node], float(found[step, node])])
    return head, rows


STUDY = Study("beam_experiment", TITLE, run, seeds=RECORDINGS)
