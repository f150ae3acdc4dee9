"""Hits in recordings of nonlinear models: a motion, a window around a hit, a search, a follower."""

from backsight.sparse.nonlinear.follower import FollowedMotion as FollowedMotion
from backsight.sparse.nonlinear.follower import FoundHit as FoundHit
from backsight.sparse.nonlinear.follower import Watch as Watch
from backsight.sparse.nonlinear.follower import follower as follower
from backsight.sparse.nonlinear.motion import ForcedMotion as ForcedMotion
from backsight.sparse.nonlinear.motion import Readings as Readings
from backsight.sparse.nonlinear.motion import readings_of as readings_of
from backsight.sparse.nonlinear.search import Offered as Offered
