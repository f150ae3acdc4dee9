"""Study of Riva, Dagen, Ortmaier: adaptive high-gain observer against EKF and UKF."""

from pathlib import Path

from backsight_studies.punch.claims import judge
from backsight_studies.punch.expected import checks
from backsight_studies.punch.experiment import Experiment, carry_out
from backsight_studies.punch.figures import draw
from backsight_studies.punch.page import TITLE, build, short
from backsight_studies.punch.tables import write_tables
from backsight_studies.study import Study, Written, from_seeds


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    claims = judge(experiment)
    found = checks(experiment, claims)
    write_tables(experiment, claims, folder)
    page = build(experiment, claims, found, draw(experiment, folder))
    return Written(found, page, short(claims, found))


STUDY = Study("punch", TITLE, from_seeds(carry_out), write, seeds=5)
