"""Study of Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012): moving horizon observer against EKF.

It takes further recordings, files in the form of `plant.read_recording`, and judges them in the
same way.
"""

from pathlib import Path

from backsight_studies.nanopositioner.claims import judge
from backsight_studies.nanopositioner.expected import checks
from backsight_studies.nanopositioner.experiment import Experiment, carry_out
from backsight_studies.nanopositioner.figures import draw
from backsight_studies.nanopositioner.page import TITLE, build, short
from backsight_studies.nanopositioner.tables import write_tables
from backsight_studies.study import Study, Written


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    claims = judge(experiment)
    found = checks(experiment, claims)
    write_tables(experiment, claims, folder)
    page = build(experiment, claims, found, draw(experiment, folder))
    return Written(found, page, short(experiment, claims, found))


STUDY = Study("nanopositioner", TITLE, carry_out, write)
