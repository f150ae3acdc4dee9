"""Values that a fit may change: as a user names them, found in estimator and model, put back."""

from backsight.tune.fitting.values._free import Choice as Choice
from backsight.tune.fitting.values._free import Free as Free
from backsight.tune.fitting.values._matrix import matrices_of as matrices_of
from backsight.tune.fitting.values._placed import placed as placed
from backsight.tune.fitting.values._placed import sensor_factors as sensor_factors
from backsight.tune.fitting.values._placed import walk_factor as walk_factor
from backsight.tune.fitting.values._placed import walk_parts as walk_parts
from backsight.tune.fitting.values._scale import AbstractScale as AbstractScale
from backsight.tune.fitting.values._scale import LogScale as LogScale
from backsight.tune.fitting.values._settings import number_at as number_at
from backsight.tune.fitting.values._settings import with_setting as with_setting
from backsight.tune.fitting.values._unknown import Unknown as Unknown
from backsight.tune.fitting.values._unknowns import unknowns_of as unknowns_of
