"""Study of the arrival costs of moving horizon estimation."""

from pathlib import Path

from backsight_studies.arrival.expected import checks
from backsight_studies.arrival.experiment import Experiment, carry_out
from backsight_studies.arrival.figures import draw
from backsight_studies.arrival.page import TITLE, build, short
from backsight_studies.arrival.tables import write_tables
from backsight_studies.study import Study, Written, from_seeds

RECORDINGS = 50
"""Of every simulated plant."""


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    found = checks(experiment)
    write_tables(experiment, folder)
    page = build(experiment, found, draw(experiment, folder))
    return Written(found, page, short(experiment, found))


STUDY = Study("arrival", TITLE, from_seeds(carry_out), write, seeds=RECORDINGS)
