"""What is told to people: alarms with a condition, a memory and a way out."""

from backsight.live.alarms._sighting import Quantities as Quantities
from backsight.live.alarms.conditions import condition_of as condition_of
from backsight.live.alarms.watching import Alarm as Alarm
from backsight.live.alarms.watching import Alarms as Alarms
