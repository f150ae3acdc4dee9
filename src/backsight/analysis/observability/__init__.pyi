"""What measurements can show of states, parameters and forces."""

from backsight.analysis.observability._dummies import dummies_that_would_do as dummies_that_would_do
from backsight.analysis.observability._flat import flat_directions as flat_directions
from backsight.analysis.observability._force_locations import (
    check_force_locations as check_force_locations,
)
from backsight.analysis.observability._force_locations import force_zeros as force_zeros
from backsight.analysis.observability._identifiability import STEP as STEP
from backsight.analysis.observability._identifiability import ExpectedBand as ExpectedBand
from backsight.analysis.observability._identifiability import Identifiability as Identifiability
from backsight.analysis.observability._observability import (
    check_observability as check_observability,
)
from backsight.analysis.observability._observability import (
    check_observability_along as check_observability_along,
)
from backsight.analysis.observability._seen import Observability as Observability
from backsight.analysis.observability._walk_dependence import REJECTED as REJECTED
from backsight.analysis.observability._walk_dependence import Trial as Trial
from backsight.analysis.observability._walk_dependence import WalkDependence as WalkDependence
from backsight.analysis.observability.zeros import rank_of as rank_of
from backsight.analysis.observability.zeros import transmission_zeros as transmission_zeros
