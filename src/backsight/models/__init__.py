"""Models: named signals, state and output equations, and what builds and changes them."""

from backsight.models.augment import augment
from backsight.models.builtin import duffing, friction_drive, sdof
from backsight.models.implicit import implicit
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.structures import (
    Substructure,
    beam,
    craig_bampton,
    modal,
    reduced,
    second_order,
)
from backsight.models.text import from_equations
from backsight.models.views.incremental import incremental
from backsight.models.views.scale import scale
from backsight.models.views.sensors import Sensor, with_sensors
from backsight.models.views.virtual import with_dummies, with_virtual

__all__ = [
    "Model",
    "Sensor",
    "Signal",
    "Substructure",
    "augment",
    "beam",
    "craig_bampton",
    "duffing",
    "friction_drive",
    "from_equations",
    "implicit",
    "incremental",
    "lti",
    "modal",
    "reduced",
    "scale",
    "sdof",
    "second_order",
    "with_dummies",
    "with_sensors",
    "with_virtual",
]
