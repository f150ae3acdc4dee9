"""Study of randomly struck beams: the paper's method beside its extensions."""

from pathlib import Path

from backsight_studies.beam_random.experiment import Experiment, carry_out
from backsight_studies.beam_random.figures import draw
from backsight_studies.beam_random.page import TITLE, build, short
from backsight_studies.beam_random.tables import write_tables
from backsight_studies.beam_random.verdicts import checks
from backsight_studies.study import Study, Written, from_seeds

SCENARIOS = 50


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    found = checks(experiment)
    write_tables(experiment, folder)
    page = build(experiment, found, draw(experiment, folder))
    return Written(found, page, short(experiment, found))


STUDY = Study("beam_random", TITLE, from_seeds(carry_out), write, seeds=SCENARIOS)
