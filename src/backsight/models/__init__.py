"""Models: named signals, state and output equations, and what builds and changes them."""

from backsight.models.augment import augment
from backsight.models.builtin import duffing, friction_drive, sdof
from backsight.models.equations import from_equations
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.scale import scale
from backsight.models.second_order import second_order
from backsight.models.signals import Signal

__all__ = [
    "Model",
    "Signal",
    "augment",
    "duffing",
    "friction_drive",
    "from_equations",
    "lti",
    "scale",
    "sdof",
    "second_order",
]
