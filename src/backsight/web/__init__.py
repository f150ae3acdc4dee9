"""What pages that are served have in common: who may ask, and what draws."""

from backsight.web.guard import OPEN as OPEN
from backsight.web.guard import Guard as Guard
