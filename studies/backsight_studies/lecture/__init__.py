"""Study of the lecture on least-squares moving horizon estimation: gains, forms, limits."""

from pathlib import Path

from backsight_studies.lecture.experiment import Experiment, carry_out
from backsight_studies.lecture.figures import draw
from backsight_studies.lecture.page import TITLE, build, short
from backsight_studies.lecture.verdicts import checks
from backsight_studies.study import Study, Written, from_seeds


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    found = checks(experiment)
    page = build(experiment, found, draw(experiment, folder))
    return Written(found, page, short(experiment, found))


STUDY = Study("lecture", TITLE, from_seeds(carry_out), write, seeds=1)
