"""Time: the clocks of sources, one even grid for all of them, and the rows on it."""

from backsight.live.clock.delays import DelayLine as DelayLine
from backsight.live.clock.grid import Placed as Placed
from backsight.live.clock.grid import Placing as Placing
from backsight.live.clock.grid import TimeCounts as TimeCounts
from backsight.live.clock.grid import TimeGrid as TimeGrid
from backsight.live.clock.rows import RowBuffer as RowBuffer
from backsight.live.clock.stamps import SourceClock as SourceClock
