"""Programs whose constants follow settings: which do, how, and what computes them."""

from backsight.engine.program.following._moved import FollowingStart as FollowingStart
from backsight.engine.program.following._moved import following as following
from backsight.engine.program.following._moved import starting as starting
