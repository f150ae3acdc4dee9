"""A recursion as a program of loops and straight-line leaves."""

from backsight.engine.program._walk import walk as walk
from backsight.engine.program.effort import Effort as Effort
from backsight.engine.program.effort import effort as effort
from backsight.engine.program.following import Beginning as Beginning
from backsight.engine.program.following import following as following
from backsight.engine.program.following import starting as starting
from backsight.engine.program.leaf import Leaf as Leaf
from backsight.engine.program.leaf import Operation as Operation
from backsight.engine.program.program import Buffer as Buffer
from backsight.engine.program.program import Call as Call
from backsight.engine.program.program import Copy as Copy
from backsight.engine.program.program import Foreign as Foreign
from backsight.engine.program.program import Loop as Loop
from backsight.engine.program.program import Program as Program
from backsight.engine.program.program import Slice as Slice
from backsight.engine.program.program import Statement as Statement
from backsight.engine.program.program import Table as Table
from backsight.engine.program.program import While as While
from backsight.engine.program.program import flat as flat
from backsight.engine.program.program import operands as operands
from backsight.engine.program.program import reads as reads
