"""Models: named signals, state and output equations, and what builds and changes them."""

from backsight.models.augment import augment
from backsight.models.beam import beam
from backsight.models.builtin import duffing, friction_drive, sdof
from backsight.models.equations import from_equations
from backsight.models.incremental import incremental
from backsight.models.lti import lti
from backsight.models.modal import modal
from backsight.models.model import Model
from backsight.models.reduced import reduced
from backsight.models.scale import scale
from backsight.models.second_order import second_order
from backsight.models.sensor_lag import sensor_lag
from backsight.models.signals import Signal

__all__ = [
    "Model",
    "Signal",
    "augment",
    "beam",
    "duffing",
    "friction_drive",
    "from_equations",
    "incremental",
    "lti",
    "modal",
    "reduced",
    "scale",
    "sdof",
    "second_order",
    "sensor_lag",
]
