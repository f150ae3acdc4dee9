"""The simulated plants: a linear one for sanity, and three on which a linearisation can fail."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy
import xarray as xr

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.augment import augment
from backsight.models.builtin import duffing
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.simulation import simulate
from backsight.types import Array

SPRING, REACTOR = "spring and damper", "batch reactor"
VAN_DER_POL, DUFFING = "van der Pol oscillator", "Duffing oscillator"

HORIZONS = (3, 10, 30)
"""Windows that are tried on every plant [samples]."""

DT = 0.1
"""Sampling period of the nonlinear plants; seconds, minutes in the reactor."""

INTEGRATOR = Integrator("rk4", substeps=2)
"""Of the estimators; the plants are simulated more finely."""


@dataclasses.dataclass(frozen=True)
class Plant:
    """A simulated plant, and what an estimator is told of it.

    Parameters
    ----------
    name : str
    model : Model
        With bounds and the unknown parameters among its states.
    noise : Noise
    prior : Prior
    judged : str
        The state whose error is compared; it is not measured.
    record : callable
        Seed to a recording with its truth.
    """

    name: str
    model: Model
    noise: Noise
    prior: Prior
    judged: str
    record: Callable[[int], xr.Dataset]

    @property
    def spread(self) -> float:
        """Standard deviation of the judged state before the first measurement."""
        index = self.model.index(self.judged)
        return float(np.sqrt(self.prior.covariance(self.model)[index, index]))

    @property
    def unit(self) -> str:
        """Of the judged state."""
        return self.model.states[self.model.index(self.judged)].unit


def unbounded(model: Model) -> Model:
    """Take the bounds off the states."""
    free = [dataclasses.replace(s, lower=-np.inf, upper=np.inf) for s in model.states]
    return dataclasses.replace(model, states=tuple(free))


def spring() -> Plant:
    """Mass on a spring with damper, the plant of an example that ships with CasADi.

    One kilogram, 1 N/m, 0.5 N s/m, a known force that is switched off half-way and an unknown
    acceleration of 0.1 m/s2 that is white; its covariance has rank one.
    """
    dt, pushing, sensor, start = 0.05, 0.1, 0.005, 0.01
    A, B = np.array([[0.0, 1.0], [-1.0, -0.5]]), np.array([[0.0], [1.0]])
    both = scipy.linalg.expm(dt * np.block([[A, B], [np.zeros((1, 3))]]))
    Ad, Bd = both[:2, :2], both[:2, 2:]
    model = lti(
        *(Ad, Bd, np.array([[1.0, 0.0]])),
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        dt=dt,
        name=SPRING,
    )
    n = 500
    force = np.where(np.arange(n) < n // 2, np.cos(dt * np.arange(n)), 0.0)

    def record(seed: int) -> xr.Dataset:
        random = np.random.default_rng([seed, 1])
        x0 = np.array([1.0, 0.0]) + start * random.standard_normal(2)
        pushes = pushing * random.standard_normal(n)
        return simulate(
            model,
            force,
            dt=dt,
            x0=list(x0),
            disturbances={"q": pushes * Bd[0, 0], "v": pushes * Bd[1, 0]},
            sigma_y=sensor,
            seed=seed,
        )

    noise = Noise(sigma_y=sensor, Q=pushing**2 * Bd @ Bd.T)
    prior = Prior(sigma_x0=start, x0={"q": 1.0})
    return Plant(SPRING, model, noise, prior, "v", record)


def reactor() -> Plant:
    """Gas in a batch reactor, 2 A and B turn into each other; only the whole pressure is measured.

    Negative pressures explain the same measurements, and the prior is poor: first example of
    Haseltine and Rawlings (2005), https://doi.org/10.1021/ie034308l.
    """
    forth, back = 0.16, 0.0064
    model = Model(
        f=lambda x, _u, _p: [
            -2 * (forth * x.pA**2 - back * x.pB),
            forth * x.pA**2 - back * x.pB,
        ],
        h=lambda x, _u, _p: [x.pA + x.pB],
        states={"pA": Signal("atm", lower=0.0), "pB": Signal("atm", lower=0.0)},
        outputs={"y": "atm"},
        name=REACTOR,
    )

    def record(seed: int) -> xr.Dataset:
        pushes = 1e-3 / DT * np.random.default_rng([seed, 2]).standard_normal((2, 121))
        return simulate(
            model,
            np.zeros((121, 0)),
            dt=DT,
            x0={"pA": 3.0, "pB": 1.0},
            disturbances={"pA": pushes[0], "pB": pushes[1]},
            sigma_y=0.1,
            seed=seed,
        )

    noise = Noise(sigma_y=0.1, sigma_w=1e-3)
    prior = Prior(sigma_x0=6.0, x0={"pA": 0.1, "pB": 4.5})
    return Plant(REACTOR, model, noise, prior, "pA", record)


def van_der_pol() -> Plant:
    """Self-excited oscillator whose nonlinearity is unknown; start and parameter from the prior."""
    plain = Model(
        f=lambda x, _u, p: [x.v, p.mu * (1 - x.q**2) * x.v - x.q],
        h=lambda x, _u, _p: [x.q],
        states={"q": Signal("", 1.0), "v": "1/s"},
        outputs={"y": ""},
        parameters={"mu": Signal("1/s", 2.0, lower=0.0)},
        name=VAN_DER_POL,
    )
    spread = {"q": 1.0, "v": 1.0, "mu": 1.0}
    record = partial(_from_prior, plain, np.zeros((201, 0)), spread, pushing=0.05, sensor=0.2)
    noise = Noise(sigma_y=0.2, sigma_w={"v": 0.05})
    return Plant(VAN_DER_POL, augment(plain, ["mu"]), noise, Prior(spread), "mu", record)


def hardening() -> Plant:
    """Duffing oscillator, driven, whose spring and damper are known to a half."""
    plain = duffing(
        k1=Signal("1/s2", 1.0, lower=0.0),
        d=Signal("1/s", 0.2, lower=0.0),
        k3=Signal("1/s2/m2", 1.0, lower=0.0),
        name=DUFFING,
    )
    spread = {"q": 1.0, "v": 1.0, "k1": 0.5, "d": 0.1, "k3": 0.5}
    force = 1.5 * np.cos(1.4 * DT * np.arange(201))
    record = partial(_from_prior, plain, force, spread, pushing=0.03, sensor=0.1)
    noise = Noise(sigma_y=0.1, sigma_w={"v": 0.03})
    model = augment(plain, ["k1", "d", "k3"])
    return Plant(DUFFING, model, noise, Prior(spread), "k3", record)


def _from_prior(
    model: Model,
    u: Array,
    spread: dict[str, float],
    seed: int,
    *,
    pushing: float,
    sensor: float,
) -> xr.Dataset:
    """Draw start and parameters from the prior; what must not be negative is mirrored."""
    random = np.random.default_rng([seed, 3])
    unknown = [p for p in model.parameters if p.name in spread]
    known = {s.name: s.value for s in (*model.states, *unknown)}
    drawn = {name: value + spread[name] * random.standard_normal() for name, value in known.items()}
    drawn |= {p.name: abs(drawn[p.name]) for p in unknown}
    return simulate(
        model,
        u,
        dt=DT,
        x0={s.name: drawn[s.name] for s in model.states},
        parameters={p.name: drawn[p.name] for p in unknown},
        disturbances={"v": pushing / DT * random.standard_normal(len(u))},
        sigma_y=sensor,
        seed=seed,
    )


def plants() -> tuple[Plant, ...]:
    """The linear one first."""
    return spring(), reactor(), van_der_pol(), hardening()
