"""Unknown forces: with dynamics, or sparse; how they are found, and what is right of them.

`GaussMarkov`, `Matern` and `Periodic` go to `backsight.augment`. Of sparse forces
`backsight.CompressiveSensingMHE` finds them sample by sample, `find_sparse_forces` in a whole
recording.
`backsight.tune` chooses weights, places of sensors, and calibrates the model.
"""

from backsight.analysis.forces import Announcement as Announcement
from backsight.analysis.forces import ForceErrors as ForceErrors
from backsight.analysis.forces import Impact as Impact
from backsight.analysis.forces import announce_hits as announce_hits
from backsight.analysis.forces import compare_forces as compare_forces
from backsight.analysis.forces import find_impacts as find_impacts
from backsight.estimators.cs_mhe import Carryover as Carryover
from backsight.estimators.cs_mhe import Exchanges as Exchanges
from backsight.estimators.cs_mhe import Reweighting as Reweighting
from backsight.estimators.dictionaries import Atoms as Atoms
from backsight.estimators.dictionaries import Decays as Decays
from backsight.estimators.dictionaries import ForceLine as ForceLine
from backsight.estimators.dictionaries import HalfSines as HalfSines
from backsight.estimators.dictionaries import Haversines as Haversines
from backsight.estimators.dictionaries import Impulses as Impulses
from backsight.estimators.dictionaries import MovingLoads as MovingLoads
from backsight.estimators.dictionaries import Splines as Splines
from backsight.estimators.dictionaries import SteadyLoads as SteadyLoads
from backsight.models.forces.moving_load import moving_load as moving_load
from backsight.models.forces.processes import GaussMarkov as GaussMarkov
from backsight.models.forces.processes import Matern as Matern
from backsight.models.forces.processes import Periodic as Periodic
from backsight.models.forces.unknown_forces import forces_as_inputs as forces_as_inputs
from backsight.run.following import follow_hits as follow_hits
from backsight.run.hits import locate_hits as locate_hits
from backsight.run.sparse_forces import find_sparse_forces as find_sparse_forces
from backsight.sparse import L1 as L1
from backsight.sparse import Given as Given
from backsight.sparse import Greedy as Greedy
from backsight.sparse import GreedyGroups as GreedyGroups
from backsight.sparse import Reweighted as Reweighted
