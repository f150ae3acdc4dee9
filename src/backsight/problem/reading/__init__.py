"""From a problem file to a problem: its tables, their keys and what they may hold."""

from backsight.problem.reading.checking import at as at
from backsight.problem.reading.kinds import ALL_KINDS as ALL_KINDS
