"""What the high-gain observers share: their own modes count for the integration step."""

import functools
from collections.abc import Mapping
from typing import ClassVar

from backsight.discrete.modes import Modes
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.observers._formulas import observer_modes, observer_steps
from backsight.models.canonical.affine import moving_states
from backsight.models.canonical.observer_form import gain_vector
from backsight.models.model import Model
from backsight.types import Array


class AbstractHighGain(AbstractEstimator):
    """An observer whose error has the poles times the gain.

    Attributes
    ----------
    gain : float
        Lambda.
    poles : complex or tuple of complex
    integrator : Integrator
    """

    varied_settings: ClassVar[tuple[str, ...]] = ("gain",)
    fixed_settings: ClassVar[Mapping[str, str]] = {
        "poles": "poles times a number are another gain; free gain"
    }

    gain: float
    poles: complex | tuple[complex, ...]
    integrator: Integrator

    def chosen(self, model: Model, dt: float) -> Integrator:
        """See `AbstractEstimator.chosen`."""
        k0, modes = self._k0(model), functools.partial(super().modes, model)
        return observer_steps(self.integrator, modes, lam=self.gain, k0=k0, dt=dt)

    def modes(self, model: Model) -> Modes:
        """Those of the model and those of the observer's error."""
        return super().modes(model) + observer_modes(self.gain, self._k0(model))

    def _k0(self, model: Model) -> Array:
        return gain_vector(self.poles, len(moving_states(model)))
