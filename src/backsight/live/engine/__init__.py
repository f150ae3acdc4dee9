"""An estimator at work on samples that come in blocks, late, or not at all."""

from backsight.live.engine.checkpoint import Checkpoint as Checkpoint
from backsight.live.engine.estimation import LiveEstimation as LiveEstimation
from backsight.live.engine.estimation import LiveRows as LiveRows
