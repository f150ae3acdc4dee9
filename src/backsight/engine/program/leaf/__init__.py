"""Straight-line arithmetic: an SX function as a list of numbered operations, and parts of it."""

from backsight.engine.program.leaf._entries import MANY as MANY
from backsight.engine.program.leaf._entries import SHARED as SHARED
from backsight.engine.program.leaf._entries import Repeated as Repeated
from backsight.engine.program.leaf._entries import entries_of as entries_of
from backsight.engine.program.leaf._leaf import OPERATIONS as OPERATIONS
from backsight.engine.program.leaf._leaf import Leaf as Leaf
from backsight.engine.program.leaf._leaf import Operation as Operation
from backsight.engine.program.leaf._leaf import Part as Part
from backsight.engine.program.leaf._leaf import leaf_of as leaf_of
from backsight.engine.program.leaf._leaf import leaf_parts as leaf_parts
from backsight.engine.program.leaf._leaf import operation_name as operation_name
