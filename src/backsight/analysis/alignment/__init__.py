"""Whether the channels of a recording belong to the same samples and units."""

from backsight.analysis.alignment._fractions import vertex as vertex
from backsight.analysis.alignment.alignment import Alignment as Alignment
from backsight.analysis.alignment.alignment import decide as decide
from backsight.analysis.alignment.alignment_scale import Ratio as Ratio
from backsight.analysis.alignment.alignment_scale import ratio as ratio
