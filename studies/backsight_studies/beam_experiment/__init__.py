"""Study of the experiment of Kirchner, Croes, Cosco, Desmet: a hammer on a beam, simulated."""

from pathlib import Path

from backsight_studies.beam_experiment.experiment import Experiment, carry_out
from backsight_studies.beam_experiment.figures import draw
from backsight_studies.beam_experiment.page import TITLE, build, short
from backsight_studies.beam_experiment.tables import write_tables
from backsight_studies.beam_experiment.verdicts import checks, judge
from backsight_studies.study import Study, Written, from_seeds

RECORDINGS = 10


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    claims = judge(experiment)
    found = checks(experiment, claims)
    write_tables(experiment, folder)
    page = build(experiment, claims, found, draw(experiment, folder))
    return Written(found, page, short(experiment, claims, found))


STUDY = Study("beam_experiment", TITLE, from_seeds(carry_out), write, seeds=RECORDINGS)
