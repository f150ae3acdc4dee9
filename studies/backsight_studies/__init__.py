"""Papers and real systems, worked through: model, data, estimators and checks."""

from backsight_studies.arrival import STUDY as ARRIVAL
from backsight_studies.beam import STUDY as BEAM
from backsight_studies.beam_experiment import STUDY as BEAM_EXPERIMENT
from backsight_studies.beam_random import STUDY as BEAM_RANDOM
from backsight_studies.frame_hammer import STUDY as FRAME_HAMMER
from backsight_studies.lecture import STUDY as LECTURE
from backsight_studies.nanopositioner import STUDY as NANOPOSITIONER
from backsight_studies.punch import STUDY as PUNCH
from backsight_studies.study import Study

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
