"""Machines with one degree of freedom that are met again and again."""

import dataclasses
import math
from typing import TypeAlias

import casadi as ca

from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.signals import Signal, signals

Parameter: TypeAlias = float | Signal
"""The value of a parameter, or a `Signal` with unit and bounds of its own."""


def sdof(
    *,
    k: Parameter,
    b: Parameter,
    c: Parameter = 1.0,
    length: str = "m",
    drive: str = "N",
    name: str = "sdof",
) -> Model:
    r"""Mass, spring and damper, everything per unit of mass (eq. 35-36).

    .. math:: \ddot q = -k\,q - b\,\dot q + c\,u

    States ``q`` [length], ``v`` [length/s]; input ``u`` [drive]; output ``y = q``.
    An unknown force is a disturbance of ``v``: ``augment(model, ["k", "b", "c"],
    disturbances={"w": "v"})`` is the joint model of eq. 37.

    Parameters
    ----------
    k : float or Signal
        Stiffness per mass, the square of the natural angular frequency [1/s2]; not negative.
    b : float or Signal
        Damping per mass [1/s]; not negative.
    c : float or Signal
        Gain of the actuator per mass [length/s2/drive].
    length, drive : str
        Units of the displacement and of the input, for example "um" and "V".
    name : str
        Shown in results.

    Raises
    ------
    ModelError
        If a value is not a number or lies outside its bounds.

    Notes
    -----
    Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer for vibration
    dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.

    Examples
    --------
    >>> print(bs.sdof(k=40.0, b=0.8))
    sdof (continuous)
    ├── states      q [m], v [m/s]
    ├── inputs      u [N]
    ├── outputs     y [m]
    └── parameters  k = 40, b = 0.8, c = 1
    """
    return Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.u],
        h=lambda x, *_: [x.q],
        states={"q": length, "v": f"{length}/s"},
        inputs={"u": drive},
        outputs={"y": length},
        parameters={
            "k": _parameter("k", k, unit="1/s2", lower=0.0),
            "b": _parameter("b", b, unit="1/s", lower=0.0),
            "c": _parameter("c", c, unit=f"{length}/s2/{drive}"),
        },
        name=name,
    )


def duffing(
    *,
    k1: Parameter,
    d: Parameter,
    k3: Parameter,
    b: Parameter = 1.0,
    length: str = "m",
    drive: str = "N",
    name: str = "duffing",
) -> Model:
    r"""Oscillator with a cubic spring, everything per unit of mass.

    .. math:: \ddot q = -k_1 q - d\,\dot q - k_3 q^3 + b\,u

    States ``q`` [length], ``v`` [length/s]; input ``u`` [drive]; output ``y = q``.

    Parameters
    ----------
    k1 : float or Signal
        Linear stiffness per mass [1/s2]; not negative.
    d : float or Signal
        Damping per mass [1/s]; not negative.
    k3 : float or Signal
        Cubic stiffness per mass [1/s2/length2]; negative for a softening spring.
    b : float or Signal
        Gain of the input per mass [length/s2/drive].
    length, drive : str
        Units of the displacement and of the input.
    name : str
        Shown in results.

    Raises
    ------
    ModelError
        If a value is not a number or lies outside its bounds.

    Notes
    -----
    The equation is that of the Silverbox circuit; source: Wigren and Schoukens (2013), "Three free
    data sets for development and benchmarking in nonlinear system identification", ECC 2013,
    doi:10.23919/ECC.2013.6669201.

    Examples
    --------
    >>> [s.name for s in bs.duffing(k1=40.0, d=0.8, k3=5.0).parameters]
    ['k1', 'd', 'k3', 'b']
    """
    return Model(
        f=lambda x, u, p: [x.v, -p.k1 * x.q - p.d * x.v - p.k3 * x.q**3 + p.b * u.u],
        h=lambda x, *_: [x.q],
        states={"q": length, "v": f"{length}/s"},
        inputs={"u": drive},
        outputs={"y": length},
        parameters={
            "k1": _parameter("k1", k1, unit="1/s2", lower=0.0),
            "d": _parameter("d", d, unit="1/s", lower=0.0),
            "k3": _parameter("k3", k3, unit=f"1/s2/{length}2"),
            "b": _parameter("b", b, unit=f"{length}/s2/{drive}"),
        },
        name=name,
    )


def friction_drive(
    *,
    M: Parameter,
    Fv: Parameter,
    Fc: Parameter,
    offset: Parameter = 0.0,
    vs: Parameter = 1e-3,
    name: str = "friction_drive",
) -> Model:
    r"""Drive with viscous and Coulomb friction.

    .. math:: M \ddot q = F - F_v \dot q - F_c \tanh(\dot q / v_s) - F_0

    States ``q`` [m], ``v`` [m/s]; input ``F`` [N]; output ``y = q``. The hyperbolic tangent
    smooths the sign function, so that the equation has a derivative at rest.

    Parameters
    ----------
    M : float or Signal
        Moving mass [kg]. Its lower bound is a thousandth of its value and not zero, because the
        equation divides by it; so is that of `vs`.
    Fv : float or Signal
        Viscous friction [N s/m]; not negative.
    Fc : float or Signal
        Coulomb friction [N]; not negative.
    offset : float or Signal
        Constant force against the motor [N].
    vs : float or Signal
        Speed at which 76 % of the Coulomb friction acts [m/s].
    name : str
        Shown in results.

    Raises
    ------
    ModelError
        If a value is not a number or lies outside its bounds.

    Notes
    -----
    Source: Janot, Gautier, Brunot (2019), "Data set and reference models of EMPS", Workshop on
    Nonlinear System Identification Benchmarks.

    Examples
    --------
    >>> [str(s.unit) for s in bs.friction_drive(M=95.0, Fv=200.0, Fc=20.0).states]
    ['m', 'm/s']
    """
    return Model(
        f=lambda x, u, p: [
            x.v,
            (u.F - p.Fv * x.v - p.Fc * ca.tanh(x.v / p.vs) - p.offset) / p.M,
        ],
        h=lambda x, *_: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={
            "M": _divisor("M", M, unit="kg"),
            "Fv": _parameter("Fv", Fv, unit="N s/m", lower=0.0),
            "Fc": _parameter("Fc", Fc, unit="N", lower=0.0),
            "offset": _parameter("offset", offset, unit="N"),
            "vs": _divisor("vs", vs, unit="m/s"),
        },
        name=name,
    )


def _parameter(name: str, given: Parameter, *, unit: str, lower: float = -math.inf) -> Signal:
    if isinstance(given, Signal):
        return given
    read = signals({name: given}, "parameter")[0]
    return dataclasses.replace(read, unit=unit, lower=lower)


def _divisor(name: str, given: Parameter, *, unit: str) -> Signal:
    read = _parameter(name, given, unit=unit)
    if isinstance(given, Signal):
        return read
    if not read.value > 0:
        raise ModelError(f"value of '{name}' is {read.value}; it must be positive")
    return dataclasses.replace(read, lower=read.value / 1000)
