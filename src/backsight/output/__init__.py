"""Files and folders that are there whole or not at all, and that replace nothing of others."""

from backsight.output._whole import HOLD as HOLD
from backsight.output._whole import MARKER as MARKER
from backsight.output._whole import holding as holding
from backsight.output._whole import put_in_place as put_in_place
from backsight.output._whole import whole as whole
from backsight.output._whole import write_whole as write_whole
from backsight.output._whole import writing as writing
