"""Hits in recordings of nonlinear models: a motion, a window around a hit, a search, a follower."""

from backsight.sparse.nonlinear.follower import FoundHit as FoundHit
from backsight.sparse.nonlinear.follower import Watch as Watch
from backsight.sparse.nonlinear.follower import follower as follower
from backsight.sparse.nonlinear.motion import Motion as Motion
from backsight.sparse.nonlinear.motion import readings as readings
from backsight.sparse.nonlinear.search import Offered as Offered
