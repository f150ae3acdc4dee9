"""Papers and real systems, worked through: model, data, estimators and checks."""

from backsight.studies.arrival import STUDY as ARRIVAL
from backsight.studies.beam import STUDY as BEAM
from backsight.studies.beam_experiment import STUDY as BEAM_EXPERIMENT
from backsight.studies.beam_random import STUDY as BEAM_RANDOM
from backsight.studies.frame_hammer import STUDY as FRAME_HAMMER
from backsight.studies.lecture import STUDY as LECTURE
from backsight.studies.nanopositioner import STUDY as NANOPOSITIONER
from backsight.studies.punch import STUDY as PUNCH
from backsight.studies.study import Study

STUDIES: dict[str, Study] = {
    s.name: s
    for s in (
        NANOPOSITIONER,
        PUNCH,
        LECTURE,
        FRAME_HAMMER,
        ARRIVAL,
        BEAM,
        BEAM_RANDOM,
        BEAM_EXPERIMENT,
    )
}
"""Every study by its name: the one place where a new one is registered."""
