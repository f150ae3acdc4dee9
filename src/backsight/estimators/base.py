"""What every estimator is: a frozen description that compiles to a recursion."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.description import Description
from backsight.discrete.runge_kutta import Hold, Integrator
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import BacksightError, TuningError
from backsight.estimators.noise_states import widened, without_noise_states
from backsight.estimators.outliers import AbstractOutlierRule
from backsight.estimators.robust import robust
from backsight.estimators.uncertainty import Noise, Prior
from backsight.kernels import library
from backsight.models.model import Model
from backsight.models.scale import scale
from backsight.models.signals import Signal
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class AbstractEstimator(Description, abc.ABC):
    """A method with its settings; knows no model and no data."""

    key: ClassVar[str]
    title: ClassVar[str]
    weighs: ClassVar[bool] = False
    """Whether samples may have a noise of their own, see `sigma_factor` of a recording."""
    noise_states: ClassVar[bool] = False
    """Whether it is right for noise as states, see `backsight.estimators.noise_states`."""
    kernels: ClassVar[tuple[str, ...]] = ()
    """Kernels in C that it calls; it cannot be built where they are not compiled."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernels:
            library.path()  # raises where the kernels are not compiled

    @property
    def assumed(self) -> tuple[Noise, Prior]:
        """The fields ``noise`` and ``prior``.

        Raises
        ------
        TuningError
            If the estimator has none.
        """
        noise, prior = getattr(self, "noise", None), getattr(self, "prior", None)
        if not (isinstance(noise, Noise) and isinstance(prior, Prior)):
            raise TuningError(f"'{self.key}' has no noise and prior")
        return noise, prior

    @property
    def horizon(self) -> int:
        """Sampling periods that the window spans, 0 of an estimator without a window."""
        return int(getattr(self, "N", 0))

    @property
    def delay(self) -> int:
        """Samples from the newest one back to that of the output: the field ``lag``, or 0."""
        return int(getattr(self, "lag", 0))

    @property
    def integration(self) -> Integrator | None:
        """The field ``integrator``, or None of an estimator that needs none."""
        given = getattr(self, "integrator", None)
        return given if isinstance(given, Integrator) else None

    @property
    def input_hold(self) -> Hold:
        """Input between samples: that of the integrator, or the field ``hold``, or held."""
        if self.integration is not None:
            return self.integration.hold
        return getattr(self, "hold", "zoh")

    @property
    def outliers(self) -> AbstractOutlierRule | None:
        """The rule for outliers of the field ``noise``; None without one."""
        noise = getattr(self, "noise", None)
        return noise.outliers if isinstance(noise, Noise) else None

    @property
    def constant_gain(self) -> bool:
        """Whether the noise of a sample changes its covariance only, not how it is corrected."""
        return False

    def variants(self) -> Mapping[str, AbstractEstimator]:
        """The estimator itself, first, and with other arrival costs; by their names."""
        return {"": self}

    def inspect(self, model: Model, dt: float) -> ca.Function:  # noqa: ARG002 - none has a window
        """Build the whole window of a sample, see `backsight.estimators.mhe._inspect`.

        Raises
        ------
        TuningError
            If the estimator has no window whose states can be looked at.
        """
        raise TuningError(f"{self.title} has no window to look at; use MHE")

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "compile" in vars(cls):
            raise BacksightError(
                f"{cls.__name__} defines 'compile'; write 'build', which 'compile' calls"
            )

    @final
    def compile(self, model: Model, dt: float) -> Recursion:
        """Turn the description into a recursion: what `build` makes, with the outlier rule.

        Parameters, result and errors are those of `build`; the recursion has the channel
        ``weight`` if the noise has a rule for outliers, see `backsight.estimators.outliers`.
        """
        rule = self.outliers
        if rule is not None and (problem := self._refusal(rule)):
            raise TuningError(problem)
        plain = self.plain(model, dt)
        return plain if rule is None else robust(plain, rule)

    @final
    def plain(self, model: Model, dt: float) -> Recursion:
        """The recursion without the rule for outliers; noise that is not additive as states."""
        method, wide = self.widened(model, dt)
        built = method.build(wide, dt)
        return built if wide is model else without_noise_states(built, model.nx)

    @final
    def widened(self, model: Model, dt: float) -> tuple[AbstractEstimator, Model]:
        """Itself and the model, or both with noise states behind the states of the model.

        Raises
        ------
        TuningError
            If the method cannot take the noise as states.
        """
        noise = getattr(self, "noise", None)
        if not (isinstance(noise, Noise) and noise.beyond_additive):
            return self, model
        given, (_, prior) = ", ".join(noise.beyond_additive), self.assumed
        if not self.noise_states:
            raise TuningError(
                f"{self.title} cannot take {given} of the noise into account; use KalmanFilter, "
                "EKF, IEKF, UKF, MHO, LinearMHE or MHE"
            )
        if self.input_hold != "zoh":
            raise TuningError(f"{given} of the noise needs inputs that are held: hold = 'zoh'")
        if getattr(self, "measurement", "sampled") != "sampled":
            raise TuningError(f"{given} of the noise goes with measurement = 'sampled' only")
        found = widened(noise, prior, model, dt, integrator=self.integration)
        changes: dict[str, Any] = {"noise": found.noise, "prior": found.prior}
        return dataclasses.replace(self, **changes), found.model

    def _refusal(self, rule: AbstractOutlierRule) -> str:
        """Why the estimator cannot follow a rule for outliers; empty if it can."""
        kind = type(rule).__name__
        if not self.weighs:
            return (
                f"{self.title} cannot weigh single samples, which outliers = {kind}() needs; use "
                "an estimator that can, such as EKF"
            )
        if self.constant_gain and not rule.leaves_out:
            return (
                f"{self.title} has a constant gain, which the weights of {kind}() cannot change; "
                "use Gate(), or an estimator that computes its gain, such as KalmanFilter"
            )
        return ""

    @abc.abstractmethod
    def build(self, model: Model, dt: float) -> Recursion:
        """Turn the description into ``(carry, u, y, mask) -> (carry, outputs)``.

        Parameters
        ----------
        model : Model
        dt : float
            Sampling period [s].

        Returns
        -------
        Recursion
            Takes u (nu,), y (ny,) and mask (ny,), 1 where y was measured; physical units. If the
            estimator `weighs`, the mask is the nominal standard deviation of the noise by that of
            the sample.

        Raises
        ------
        TuningError, ModelError
            If the description does not fit the model.
        """


WALK_SAMPLES = 100
"""Samples of random walk that count for the size of a state without a scale."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """A model with its noise and prior in scaled variables.

    Parameters
    ----------
    model : Model
        Scaled.
    dt : float
        Sampling period [s].
    x0, P0, Q, R : arrays
        Scaled; `Q` is a spectral density if the model is continuous, else per sample.
    sx, su, sy : arrays
        Scales of states, inputs, outputs.
    """

    model: Model
    dt: float
    x0: Array
    P0: Array
    Q: Array
    R: Array
    sx: Array
    su: Array
    sy: Array

    @property
    def lower(self) -> Array:
        """Lower bounds of the scaled states, (nx,)."""
        return np.array([s.lower for s in self.model.states])

    @property
    def upper(self) -> Array:
        """Upper bounds of the scaled states, (nx,)."""
        return np.array([s.upper for s in self.model.states])

    def enter(self) -> ca.Function:
        """Physical to scaled data: (u, y, mask) -> (u, y, mask).

        In parts, so that what depends on the inputs alone can be told from what the mask changes.
        """
        u, y, mask = data_symbols(self.model)
        scaled_u = ca.Function("enter_u", [u], [u / self.su])
        scaled_y = ca.Function("enter_y", [y], [y / self.sy])
        data = [ca.MX.sym(f"d{i}", k.numel()) for i, k in enumerate((u, y, mask))]
        results = [scaled_u(data[0]), scaled_y(data[1]), data[2]]
        return ca.Function("enter", data, results, {"always_inline": True})

    def physical(self, x: ca.SX, vP: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Physical state (nx,) and lower triangle of its covariance, of scaled ones."""
        return ca.SX(self.sx) * x, vech(unvech(vP) * ca.SX(np.outer(self.sx, self.sx)))


def setting(model: Model, dt: float, *, noise: Noise, prior: Prior) -> Setting:
    """Check noise and prior against the model, all messages at once, and scale everything.

    A state without a `Signal.scale` is scaled by the size of its prior and of its random walk, an
    output by its noise.

    Raises
    ------
    TuningError
        If anything does not fit.
    """
    if not model.continuous and not np.isclose(model.dt or 0.0, dt, rtol=1e-2):
        raise TuningError(f"the model has dt = {model.dt:g} s but the recording {dt:g} s")
    found: dict[str, Array] = {}
    problems = []
    for name, read in {
        "x0": lambda: prior.mean(model),
        "P0": lambda: prior.covariance(model),
        "Q": lambda: noise.process(model, dt),
        "R": lambda: noise.measurement(model),
    }.items():
        try:
            found[name] = read()
        except BacksightError as error:
            problems.append(str(error))
    if problems:
        raise TuningError("; ".join(problems))
    walk = np.diag(found["Q"]) * (dt if model.continuous else 1.0)
    spread = np.sqrt(np.diag(found["P0"]) + WALK_SAMPLES * walk)
    typical = np.maximum(np.abs(found["x0"]), spread)
    sized = dataclasses.replace(
        model,
        states=_with_scales(model.states, typical),
        outputs=_with_scales(model.outputs, np.sqrt(np.diag(found["R"]))),
    )
    sx, su, sy = (
        np.array([s.scale or 1.0 for s in group])
        for group in (sized.states, sized.inputs, sized.outputs)
    )
    return Setting(
        model=scale(sized),
        dt=dt,
        x0=found["x0"] / sx,
        P0=found["P0"] / np.outer(sx, sx),
        Q=found["Q"] / np.outer(sx, sx),
        R=found["R"] / np.outer(sy, sy),
        sx=sx,
        su=su,
        sy=sy,
    )


def data_symbols(model: Model) -> tuple[ca.SX, ca.SX, ca.SX]:
    """u (nu,), y (ny,), mask (ny,)."""
    return ca.SX.sym("u", model.nu), ca.SX.sym("y", model.ny), ca.SX.sym("mask", model.ny)


ESTIMATE_CHANNELS = (
    Channel("x_hat", ("state",)),
    Channel("P", ("state", "state_"), symmetric=True),
    Channel("y_hat", ("output",)),
    Channel("e", ("output",)),
    Channel("S", ("output", "output_"), symmetric=True),
    Channel("status"),
)
"""Outputs that every estimator has, in this order."""


def _with_scales(group: tuple[Signal, ...], typical: Array) -> tuple[Signal, ...]:
    return tuple(
        s if s.scale is not None or t == 0 else dataclasses.replace(s, scale=float(t))
        for s, t in zip(group, typical, strict=True)
    )
