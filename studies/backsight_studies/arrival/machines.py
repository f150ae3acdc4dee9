"""Measured machines: parameters from starts that are wrong by half.

Recordings of nonlinearbenchmark.org, read from the folder that the environment variable
``BACKSIGHT_DATA`` names; the problem files among the examples say which. Sources: Wigren and
Schoukens, "Three free data sets for development and benchmarking in nonlinear system
identification", ECC 2013, https://doi.org/10.23919/ECC.2013.6669201 (Silverbox); Janot, Gautier,
Brunot, "Data set and reference models of EMPS", 2019.
"""

import dataclasses
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.data.columns import Column
from backsight.data.reader import read
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman import EKF
from backsight.estimators.mhe import MHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.augment import augment
from backsight.models.builtin import duffing
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.text.equations import from_equations
from backsight.run.estimation import estimate
from backsight.types import Array

FOLDER = "BACKSIGHT_DATA"

FILTER, WINDOW = "EKF", "MHE"

DRAWN = 1000
"""Points of a line in a figure, about."""


@dataclasses.dataclass(frozen=True)
class Machine:
    """A measured machine.

    Parameters
    ----------
    name : str
    file : str
        Below the folder.
    signals : dict
        Arguments of `read`.
    reference : dict
        Parameter to the value that others found.
    within : dict
        Parameter to the relative error that counts as converged.
    starts : tuple of float
        Factors of all parameters at the start.
    shown : float
        How much of the recording is drawn [s].
    build : callable
        Start factor to model, noise, prior.
    integrator : Integrator
    """

    name: str
    file: str
    signals: Mapping[str, dict[str, Column]]
    reference: Mapping[str, float]
    within: Mapping[str, float]
    starts: tuple[float, ...]
    shown: float
    build: Callable[[float], tuple[Model, Noise, Prior]]
    integrator: Integrator

    @property
    def path(self) -> Path | None:
        """The recording; None if it is not there."""
        folder = os.environ.get(FOLDER)
        found = Path(folder) / self.file if folder else None
        return found if found and found.is_file() else None


@dataclasses.dataclass(frozen=True)
class Convergence:
    """How an estimator found the parameters of a machine.

    Parameters
    ----------
    machine, label : str
    start : float
        Factor of the parameters at the start.
    time : dict
        Parameter to the time from which on it stays as near to its reference as it should [s];
        infinite for never.
    error, deviations : dict
        Of the last estimate: relative, and in its standard deviations.
    us_per_sample : float
    series : dict
        What is drawn: ``time`` and every parameter divided by its reference.
    """

    machine: str
    label: str
    start: float
    time: dict[str, float]
    error: dict[str, float]
    deviations: dict[str, float]
    us_per_sample: float
    series: dict[str, Array]

    @property
    def all_after(self) -> float:
        """Time until all have converged [s]."""
        return max(self.time.values())


@dataclasses.dataclass(frozen=True)
class Task:
    """One estimator on one machine from one start."""

    machine: Machine
    label: str
    start: float

    @property
    def what(self) -> str:
        """For the progress bar."""
        return f"{self.machine.name}, start {self.start:g}: {self.label}"

    def carry_out(self) -> Convergence:
        """Estimate and judge."""
        machine = self.machine
        model, noise, prior = machine.build(self.start)
        estimators: dict[str, AbstractEstimator] = {
            FILTER: EKF(noise, prior, machine.integrator),
            WINDOW: MHE(noise, prior, N=15, integrator=machine.integrator),
        }
        assert machine.path is not None
        recording = read(
            machine.path,
            time="t_s",
            inputs=machine.signals["inputs"],
            outputs=machine.signals["outputs"],
        )
        return judge(
            machine, self.label, self.start, estimate(estimators[self.label], model, recording)
        )


def tasks() -> tuple[Task, ...]:
    """Everything to be done on the recordings that are there."""
    there = [m for m in MACHINES if m.path is not None]
    return tuple(Task(m, label, f) for m in there for f in m.starts for label in (FILTER, WINDOW))


def judge(machine: Machine, label: str, start: float, result: xr.Dataset) -> Convergence:
    """Hold the estimated parameters against their references."""
    time = result["time"].values
    count = int(np.searchsorted(time, machine.shown))
    part = slice(0, count, max(1, count // DRAWN))
    series = {"time": time[part]}
    after, error, deviations = {}, {}, {}
    for name, true in machine.reference.items():
        value = result["x_hat"].sel(state=name).values
        off = value / true - 1.0
        after[name] = _settled(time, np.abs(off) - machine.within[name])
        error[name] = float(off[-1])
        std = float(result["x_std"].sel(state=name).values[-1])
        deviations[name] = float((value[-1] - true) / std)
        series[name] = (value / true)[part]
    speed = float(result.attrs["us_per_sample"])
    return Convergence(machine.name, label, start, after, error, deviations, speed, series)


def _settled(time: Array, excess: Array) -> float:
    """Time from which on the excess is never positive."""
    outside = np.flatnonzero(excess > 0)
    if len(outside) == 0:
        return 0.0
    return float(time[outside[-1] + 1]) if outside[-1] + 1 < len(time) else np.inf


def _silverbox(start: float) -> tuple[Model, Noise, Prior]:
    """Everything per unit of mass; gain of the input unknown, too."""
    true = SILVERBOX.reference
    plain = duffing(
        k1=Signal("1/s2", start * true["k1"], lower=0.0),
        d=Signal("1/s", start * true["d"], lower=0.0),
        k3=Signal("1/s2/V2", start * true["k3"], lower=0.0),
        b=Signal("V/s2/V", start * 1.86e5),
        length="V",
        drive="V",
        name="Silverbox",
    )
    walks = {"v": 0.05, "k1": 5.0, "d": 0.006, "k3": 50.0, "b": 5.0}
    spread = {name: 0.6 * value for name, value in {**true, "b": 1.86e5}.items()}
    return (
        augment(plain, ["k1", "d", "k3", "b"]),
        Noise(sigma_y=2e-3, sigma_w=walks),
        Prior({"q": 0.3, "v": 100.0, **spread}),
    )


def _drive(start: float) -> tuple[Model, Noise, Prior]:
    """Drive with friction and a force that the model lacks and that fades within 50 ms."""
    true = DRIVE.reference
    plain = from_equations(
        states={"q": "m", "v": "m/s", "D": "N"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={
            "vs": Signal("m/s", 1e-3),
            "tau": Signal("s", 0.05),
            "M": Signal("kg", start * true["M"], lower=1.0),
            "Fv": Signal("N s/m", start * true["Fv"], lower=0.0),
            "Fc": Signal("N", start * true["Fc"], lower=0.0),
            "offset": Signal("N", start * true["offset"]),
        },
        equations={
            "q": "v",
            "v": "(F - Fv*v - Fc*tanh(v/vs) - offset + D) / M",
            "D": "-D / tau",
        },
        output_equations={"y": "q"},
        name="EMPS",
    )
    spread = {name: 0.6 * abs(value) for name, value in true.items()}
    return (
        augment(plain, ["M", "Fv", "Fc", "offset"]),
        Noise(sigma_y=3e-6, sigma_w={"v": 1e-4, "D": 0.2}),
        Prior({"q": 0.3, "v": 0.1, "D": 1.0, **spread}),
    )


SILVERBOX = Machine(
    name="Silverbox",
    file="silverbox/silverbox_multisine.csv",
    signals={
        "inputs": {"u": Column("u_V", unit="V", remove_mean=True)},
        "outputs": {"y": Column("y_V", unit="V", remove_mean=True)},
    },
    reference={"k1": 184186.0, "d": 41.953, "k3": 733023.0},
    within={"k1": 0.01, "d": 0.03, "k3": 0.03},
    starts=(0.5, 1.5),
    shown=1.5,
    build=_silverbox,
    integrator=Integrator("rk4", substeps=2, hold="foh"),
)

DRIVE = Machine(
    name="EMPS",
    file="emps/emps_estimation.csv",
    signals={
        "inputs": {"F": Column("F_motor_N", unit="N")},
        "outputs": {"y": Column("q_meas_m", unit="m")},
    },
    reference={"M": 95.109, "Fv": 203.50, "Fc": 20.394, "offset": -3.165},
    within={"M": 0.005, "Fv": 0.02, "Fc": 0.03, "offset": 0.05},
    starts=(0.5,),
    shown=25.0,
    build=_drive,
    integrator=Integrator("rk4", 1),
)

MACHINES = (SILVERBOX, DRIVE)
