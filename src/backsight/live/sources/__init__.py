"""Where samples come from."""

from backsight.live.sources.base import Batch as Batch
from backsight.live.sources.base import LiveSource as LiveSource
from backsight.live.sources.base import wanted_columns as wanted_columns
from backsight.live.sources.making import source_of as source_of
