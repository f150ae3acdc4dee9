"""From a description to a recursion: what is the same for every method."""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, ClassVar, Literal, Self, TypeAlias, final

import numpy as np

from backsight.description import Description
from backsight.discrete.modes import Modes, modes_at, modes_over
from backsight.discrete.runge_kutta import Hold, Integrator
from backsight.discrete.steps import complaint, explicit, settle_steps
from backsight.engine.building import built_alone
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.errors import BacksightError, TuningError
from backsight.estimators.around.noise_states import linear_in_noise, widened, without_noise_states
from backsight.estimators.around.positive import in_their_units, logarithmic
from backsight.estimators.around.robust import robust
from backsight.estimators.around.saturation import within_range
from backsight.estimators.around.turns import on_circle
from backsight.estimators.around.virtual import (
    smoothed_with_virtual_outputs,
    surroundings,
    with_virtual_outputs,
    without_covariance,
)
from backsight.estimators.around.virtual_bands import Surroundings
from backsight.estimators.outliers import AbstractOutlierRule
from backsight.estimators.uncertainty import Noise, Prior
from backsight.estimators.varied_noise import VariedNoise
from backsight.models.model import Model
from backsight.schema import WEIGHT, Status
from backsight.types import Array

Spread: TypeAlias = Literal["full", "std"]
"""What a smoother puts out of the covariance: all of it, or standard deviations."""


@dataclasses.dataclass(frozen=True)
class Compilable(Description, abc.ABC):
    """A method that builds a recursion, with what goes around it: noise states, outlier rules."""

    key: ClassVar[str]
    title: ClassVar[str]
    weighs: ClassVar[bool] = False
    """Whether samples may have a noise of their own, see `sigma_factor` of a recording."""
    seeks_surprises: ClassVar[bool] = False
    """Whether surprising samples are what it looks for, so that no rule may hide them."""
    noise_states: ClassVar[bool] = False
    """Whether it is right for noise as states, see `backsight.estimators.around.noise_states`."""
    looks_back: ClassVar[bool] = False
    """Whether it looks at noisy inputs twice, see `parts.filtering.noise_to_look_back_at`."""
    varies_noise: ClassVar[tuple[str, ...]] = ()
    """What inputs may make up: Q (with Qc), R; see `backsight.estimators.varied_noise`."""
    varied_settings: ClassVar[tuple[str, ...]] = ()
    """Settings that may be inputs, see `backsight.estimators.varied_number`."""

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
            raise TuningError(f"{self.title} has no noise and prior")
        return noise, prior

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

    def chosen(self, model: Model, dt: float) -> Integrator | None:
        """The integrator with nothing left open, None if the estimator or the model needs none.

        A matrix exponential does not follow parameters that are noise and not simply added.
        """
        if self.integration is None or not model.continuous:
            return None
        found = settle_steps(self.integration, model, lambda: self.modes(model), dt=dt)
        noise = getattr(self, "noise", None)
        follows = not isinstance(noise, Noise) or linear_in_noise(noise, model)
        if found.scheme != "exact" or follows:
            return found
        return explicit(self.integration, lambda: self.modes(model), dt=dt)

    def modes(self, model: Model) -> Modes:
        """What has to be carried over: the modes of the model over the range of the prior."""
        prior = getattr(self, "prior", None)
        if not isinstance(prior, Prior):
            start = np.array([s.value for s in model.states])
            return modes_over(model, start, np.zeros(model.nx))
        return modes_over(model, prior.mean(model), np.sqrt(np.diag(prior.covariance(model))))

    @property
    def outliers(self) -> AbstractOutlierRule | None:
        """The rule for outliers of the field ``noise``; None without one."""
        noise = getattr(self, "noise", None)
        return noise.outliers if isinstance(noise, Noise) else None

    @property
    def constant_gain(self) -> bool:
        """Whether the noise of a sample changes its covariance only, not how it is corrected."""
        return False

    def varied(self, *, parameters: bool) -> Compilable:  # noqa: ARG002 - itself mostly
        """Return the method that finds the same while values of noise and model are inputs.

        Parameters
        ----------
        parameters : bool
            Whether parameters of the model are among them: a linear model is then none any more.
        """
        return self

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "compile" in vars(cls):
            raise BacksightError(
                f"{cls.__name__} defines 'compile'; write 'build', which 'compile' calls"
            )

    @final
    @built_alone
    def compile(self, model: Model, dt: float) -> Recursion:
        """Turn the description into a recursion: what `build` makes, with what surrounds it.

        Virtual outputs, sensors at the end of their range, angles that start anew after a turn, and
        the rule for outliers, which adds the channel ``weight``. Errors are those of `build`.
        """
        if (rule := self.outliers) is not None and (problem := self.unfit_for(rule)):
            raise TuningError(problem)
        noise = getattr(self, "noise", None)
        able = () if self.constant_gain else self.varies_noise
        if isinstance(noise, VariedNoise) and (problem := noise.beyond(able)):
            raise TuningError(f"{self.title} takes no {problem} noise that inputs multiply")
        plain = on_circle(within_range(self.plain(model, dt), model), model)
        return plain if rule is None else robust(plain, rule)

    @final
    def plain(self, model: Model, dt: float) -> Recursion:
        """The recursion without the rule for outliers, with virtual outputs.

        Noise that is not additive is among the states; positive states are estimated as logarithms.
        """
        if any(s.positive for s in model.states):
            method, inner, at = self._logarithmic(model)
            return in_their_units(method.plain(inner, dt), at)
        method, wide = self.widened(model, dt, remembered=self.looks_back)
        built = method.build(wide, dt)
        if wide.virtual is not None:
            built = with_virtual_outputs(built, method.surroundings(wide, dt))
        if wide is model:
            return built
        # The widened model is in discrete time: of its integrator the method knows nothing.
        raised = Status.COARSE_STEP if self._coarse(model, dt) else Status(0)
        return without_noise_states(built, model.nx, raised=raised)

    @final
    @built_alone
    def both_ways(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """What `smoother` makes, with virtual outputs and outlier rule; noise as states.

        The weights of the way forward hold on the way back, too. Positive states are estimated as
        logarithms. Parameters, result and errors are those of `AbstractEstimator.smoother`.
        """
        if any(s.positive for s in model.states):
            method, inner, at = self._logarithmic(model)
            passes = method.both_ways(inner, dt, covariance=covariance)
            return dataclasses.replace(passes, backward=in_their_units(passes.backward, at))
        rule = self.outliers
        if rule is not None and (problem := self.unfit_for(rule)):
            raise TuningError(problem)
        method, wide = self.widened(model, dt)
        found = method.smoother(wide, dt, covariance="full" if wide.virtual else covariance)
        if wide.virtual is not None:
            # Bands of virtual outputs need all of the covariance, whatever is put out of it.
            found = smoothed_with_virtual_outputs(found, method.surroundings(wide, dt))
            found = found if covariance == "full" else without_covariance(found)
        if rule is not None:
            # The rule needs the covariance of the innovations, whether it is put out or not.
            full = method.smoother(wide, dt, covariance="full").forward
            forward = robust(full, rule)
            if covariance == "std":
                forward = forward.without("S")
            names = [channel.name for channel in forward.channels]
            found = ForwardBackward(forward, found.backward, names.index(WEIGHT))
        if wide is model:
            return found
        raised = Status.COARSE_STEP if self._coarse(model, dt) else Status(0)
        backward = without_noise_states(found.backward, model.nx, raised=raised)
        return dataclasses.replace(found, backward=backward)

    @abc.abstractmethod
    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`."""

    @final
    def widened(self, model: Model, dt: float, *, remembered: bool = False) -> tuple[Self, Model]:
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
            raise TuningError(f"{self.title} cannot take {given} of the noise; use EKF or MHE")
        if self.input_hold != "zoh":
            raise TuningError(f"{given} of the noise needs inputs that are held: hold = 'zoh'")
        if getattr(self, "measurement", "sampled") != "sampled":
            raise TuningError(f"{given} of the noise goes with measurement = 'sampled' only")
        at = self.chosen(model, dt)
        found = widened(noise, prior, model, dt, integrator=at, remembered=remembered)
        changes: dict[str, Any] = {"noise": found.noise, "prior": found.prior}
        return dataclasses.replace(self, **changes), found.model

    def _logarithmic(self, model: Model) -> tuple[Self, Model, Array]:
        """Itself and the model with logarithms of positive states, and their start values."""
        noise, prior = self.assumed
        if getattr(self, "limits", ()):
            raise TuningError("limits do not go with states that are positive; leave out positive")
        found = logarithmic(noise, prior, model)
        changes: dict[str, Any] = {"noise": found.noise, "prior": found.prior}
        return dataclasses.replace(self, **changes), found.model, found.at

    def surroundings(self, model: Model, dt: float) -> Surroundings:
        """What virtual outputs must know beside what the method puts out."""
        noise = getattr(self, "noise", None)
        noise = noise if isinstance(noise, Noise) else None
        return surroundings(model, dt, noise=noise, background=self.background(model))

    def background(self, model: Model) -> Array:  # noqa: ARG002 - none has any
        """Standard deviation of forces that act beside those that it finds, (nf,)."""
        return np.zeros(0)

    def _coarse(self, model: Model, dt: float) -> bool:
        """Whether the integrator is too coarse for the model at the prior's mean."""
        chosen = self.chosen(model, dt)
        if chosen is None:
            return False
        x0, still = self.assumed[1].mean(model)[None], np.zeros((1, model.nu))
        return bool(complaint(chosen, lambda: modes_at(model, x0, still), dt=dt))

    def unfit_for(self, rule: AbstractOutlierRule) -> str:
        """Why the estimator cannot follow a rule for outliers; empty if it can."""
        kind = type(rule).__name__
        if self.seeks_surprises:
            return f"outliers = {kind}() would take hits for outliers; weigh by sigma_factor"
        if rule.leaves_out or (self.weighs and not self.constant_gain):
            return ""  # what is left out is as if not measured, which every estimator knows
        cannot = "has a constant gain, which cannot" if self.constant_gain else "cannot"
        return (
            f"{self.title} {cannot} weigh single samples, which outliers = {kind}() needs; use "
            "Gate(), or an estimator that computes its gain, such as KalmanFilter or EKF"
        )

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
            Takes u (nu,), y (ny,) and mask (ny,), 1 where y was measured; physical units. If it
            `weighs`, the mask is the nominal standard deviation by that of the sample.

        Raises
        ------
        TuningError, ModelError
            If the description does not fit the model.
        """
