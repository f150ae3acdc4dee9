"""Recordings with settings as they are worked on: by whom, and when, is no matter of theirs."""

from backsight.fleet.items._doing import done as done
from backsight.fleet.items._reading import problem_with as problem_with
from backsight.fleet.items._reading import said_with as said_with
from backsight.fleet.items.work import Item as Item
from backsight.fleet.items.work import Work as Work
from backsight.fleet.items.work import version_here as version_here
