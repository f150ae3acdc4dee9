"""Many recordings and long ones: totals instead of results, parts instead of the whole."""

from backsight.data.parts import RecordingParts as RecordingParts
from backsight.data.parts import read_parts as read_parts
from backsight.run.estimation.results.outputs import Outputs as Outputs
from backsight.run.parts import estimate_parts as estimate_parts
from backsight.run.parts import read_store as read_store
from backsight.run.parts import smooth_parts as smooth_parts
from backsight.run.summaries import estimate_summaries as estimate_summaries
