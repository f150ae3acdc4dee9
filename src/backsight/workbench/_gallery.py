"""Machines to choose from: their equations, what may be measured of them, and what is unknown."""

import dataclasses
from collections.abc import Mapping

OTHER = "equations"
"""Key of the machine that is described by equations of the user."""


@dataclasses.dataclass(frozen=True)
class Slot:
    """A signal of a machine that a column of the recording may be.

    Parameters
    ----------
    name, unit, meaning : str
    words : tuple of str
        Parts of names that such a column often has.
    formula : str
        Of an output: in states and constants.
    needs : tuple of str
        States that are there only if this output is measured: nothing else would show them.
    """

    name: str
    unit: str
    meaning: str
    words: tuple[str, ...]
    formula: str = ""
    needs: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Constant:
    """A number in the equations.

    Parameters
    ----------
    name, unit, meaning : str
    value : float
        To begin with [`unit`].
    unknown : bool
        Whether it is estimated unless the user says that it is known.
    positive : bool
        Whether it cannot be negative.
    """

    name: str
    unit: str
    meaning: str
    value: float
    unknown: bool = True
    positive: bool = True


@dataclasses.dataclass(frozen=True)
class Load:
    """A force or torque in the equations that nobody measures; it wanders.

    Parameters
    ----------
    name, unit, meaning : str
    size : float
        Its standard deviation to begin with [`unit`].
    """

    name: str
    unit: str
    meaning: str
    size: float


@dataclasses.dataclass(frozen=True)
class MachineState:
    """A state of a machine.

    Parameters
    ----------
    unit : str
    rate : str
        Its equation.
    motion : bool
        Whether the equation is of motion; false: the state is an integral, which is exact.
    """

    unit: str
    rate: str
    motion: bool = True


@dataclasses.dataclass(frozen=True)
class Machine:
    """A machine of the gallery.

    Parameters
    ----------
    title, about : str
        Its name, and a sentence.
    states : dict
        Name to `MachineState`.
    inputs, outputs : tuple of Slot
        An input that is not measured is zero.
    constants : tuple of Constant
    loads : tuple of Load
    """

    title: str
    about: str
    states: Mapping[str, MachineState]
    inputs: tuple[Slot, ...]
    outputs: tuple[Slot, ...]
    constants: tuple[Constant, ...]
    loads: tuple[Load, ...]


_FORCE = ("force", "kraft", "load cell", "hammer")
_TORQUE = ("torque", "moment", "drehmoment")
_CURRENT = ("current", "strom")
_SPEED = ("speed", "velocity", "drehzahl", "omega", "geschwindigkeit")
_PLACE = ("position", "displacement", "deflection", "weg", "pos")
_ANGLE = ("angle", "winkel", "encoder")
_ACCELERATION = ("acc", "beschleunigung")

GALLERY: dict[str, Machine] = {
    "mass_spring": Machine(
        "Mass on a spring",
        "One mass, a spring and a damper; a force drives it, measured or not.",
        {
            "q": MachineState("m", "v", motion=False),
            "v": MachineState("m/s", "(F + w - c*v - k*q) / m"),
        },
        inputs=(Slot("F", "N", "driving force", _FORCE),),
        outputs=(
            Slot("position", "m", "displacement", _PLACE, "q"),
            Slot("velocity", "m/s", "velocity", _SPEED, "v"),
            Slot(
                "acceleration",
                "m/s2",
                "acceleration",
                _ACCELERATION,
                "(F + w - c*v - k*q) / m",
            ),
        ),
        constants=(
            Constant("m", "kg", "mass", 1.0, unknown=False),
            Constant("c", "N s/m", "damping", 1.0),
            Constant("k", "N/m", "stiffness", 1000.0),
        ),
        loads=(Load("w", "N", "unknown force on the mass", 1.0),),
    ),
    "friction_drive": Machine(
        "Drive with friction",
        "A slide or an axis: mass, viscous and Coulomb friction, and a force of the drive.",
        {
            "q": MachineState("m", "v", motion=False),
            "v": MachineState("m/s", "(F - Fv*v - Fc*tanh(v/vs) - load) / M"),
        },
        inputs=(Slot("F", "N", "force of the drive", _FORCE),),
        outputs=(
            Slot("position", "m", "position", _PLACE, "q", needs=("q",)),
            Slot("velocity", "m/s", "velocity", _SPEED, "v"),
        ),
        constants=(
            Constant("M", "kg", "moving mass", 50.0),
            Constant("Fv", "N s/m", "viscous friction", 100.0),
            Constant("Fc", "N", "Coulomb friction", 10.0),
            Constant("vs", "m/s", "speed below which friction sets in", 1e-3, unknown=False),
        ),
        loads=(Load("load", "N", "unknown load against the motion", 5.0),),
    ),
    "motor": Machine(
        "Motor with a load",
        "A motor turns something: inertia, viscous friction, and a load that nobody measures.",
        {
            "phi": MachineState("rad", "w", motion=False),
            "w": MachineState("rad/s", "(kt*i - b*w - load) / J"),
        },
        inputs=(Slot("i", "A", "current of the motor", _CURRENT),),
        outputs=(
            Slot("speed", "rad/s", "speed", _SPEED, "w"),
            Slot("angle", "rad", "angle", _ANGLE, "phi", needs=("phi",)),
        ),
        constants=(
            Constant("kt", "Nm/A", "torque constant, from the data sheet", 0.1, unknown=False),
            Constant("J", "kg m2", "inertia", 1e-3),
            Constant("b", "Nm s/rad", "viscous friction", 1e-3),
        ),
        loads=(Load("load", "Nm", "unknown load torque", 0.1),),
    ),
    "two_masses": Machine(
        "Two masses on a shaft",
        "A motor drives a load through an elastic shaft: two inertias, stiffness and damping.",
        {
            "twist": MachineState("rad", "w1 - w2", motion=False),
            "w1": MachineState("rad/s", "(T - d*(w1 - w2) - c*twist - b*w1) / J1"),
            "w2": MachineState("rad/s", "(d*(w1 - w2) + c*twist - load) / J2"),
        },
        inputs=(Slot("T", "Nm", "torque of the motor", _TORQUE),),
        outputs=(
            Slot("motor_speed", "rad/s", "speed of the motor", (*_SPEED, "motor"), "w1"),
            Slot("load_speed", "rad/s", "speed of the load", (*_SPEED, "load"), "w2"),
        ),
        constants=(
            Constant("J1", "kg m2", "inertia of the motor", 1e-3, unknown=False),
            Constant("J2", "kg m2", "inertia of the load", 1e-3),
            Constant("c", "Nm/rad", "stiffness of the shaft", 100.0),
            Constant("d", "Nm s/rad", "damping of the shaft", 0.01),
            Constant("b", "Nm s/rad", "viscous friction of the motor", 1e-3, unknown=False),
        ),
        loads=(Load("load", "Nm", "unknown load torque", 0.1),),
    ),
}
"""Every machine but that of equations by its key."""
