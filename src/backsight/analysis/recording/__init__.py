"""Whether the channels of a recording belong to the same samples and units."""

from backsight.analysis.recording.alignment import Alignment as Alignment
from backsight.analysis.recording.alignment import decide as decide
from backsight.analysis.recording.alignment import vertex as vertex
from backsight.analysis.recording.alignment_scale import Ratio as Ratio
from backsight.analysis.recording.alignment_scale import ratio as ratio
