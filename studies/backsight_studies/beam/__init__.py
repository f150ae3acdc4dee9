"""Study of Kirchner, Croes, Cosco, Desmet: where, when and how hard a beam was hit."""

from pathlib import Path

from backsight_studies.beam.claims import judge
from backsight_studies.beam.experiment import Experiment, carry_out
from backsight_studies.beam.figures import draw
from backsight_studies.beam.page import TITLE, build, short
from backsight_studies.beam.tables import write_tables
from backsight_studies.beam.verdicts import checks
from backsight_studies.study import Study, Written, from_seeds


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    claims = judge(experiment)
    found = checks(experiment, claims)
    write_tables(experiment, claims, folder)
    page = build(experiment, claims, found, draw(experiment, folder))
    return Written(found, page, short(experiment, claims, found))


STUDY = Study("beam", TITLE, from_seeds(carry_out), write)
