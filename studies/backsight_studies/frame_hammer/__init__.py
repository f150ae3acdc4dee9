"""Study of a beam under hammer blows: where, when and how hard, without the hammer's signal.

The two measured recordings of the data set are taken from the folder that the environment variable
BACKSIGHT_DATA names; it takes further ones, NumPy files as described in `source.read`.
"""

from pathlib import Path

from backsight_studies.frame_hammer.experiment import Experiment, carry_out
from backsight_studies.frame_hammer.figures import draw
from backsight_studies.frame_hammer.page import TITLE, build, short
from backsight_studies.frame_hammer.tables import write_tables
from backsight_studies.frame_hammer.verdicts import checks
from backsight_studies.study import Study, Written


def write(experiment: Experiment, folder: Path) -> Written:
    """Judge the experiment; write its tables and figures."""
    found = checks(experiment)
    write_tables(experiment, folder)
    page = build(experiment, found, draw(experiment, folder))
    return Written(found, page, short(experiment, found))


STUDY = Study("frame_hammer", TITLE, carry_out, write)
