"""What every estimator is: a frozen description that compiles to a recursion."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import ClassVar, final

from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.errors import TuningError
from backsight.estimators._compiling import Compilable
from backsight.estimators._compiling import Spread as Spread
from backsight.estimators._inspection import Inspection
from backsight.estimators.around.misled import watched
from backsight.estimators.scaled import Setting
from backsight.kernels import library
from backsight.models.model import Model
from backsight.schema import Innovations


@dataclasses.dataclass(frozen=True)
class AbstractEstimator(Compilable, abc.ABC):
    """A method with its settings; knows no model and no data."""

    kernels: ClassVar[tuple[str, ...]] = ()
    """Kernels in C that it calls; it cannot be built where they are not compiled."""
    multiplied_settings: ClassVar[tuple[str, ...]] = ()
    """Settings of several numbers that a factor can change together."""
    fixed_settings: ClassVar[Mapping[str, str]] = {}
    """Why numbers among the settings cannot be found from a recording, by the name of the field."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernels:
            library.path()  # raises where the kernels are not compiled

    @property
    def innovations(self) -> Innovations:
        """What its innovations are if model and noise are right, see `schema.Innovations`.

        Those of any gain but the Kalman filter's follow from each other.
        """
        return "coloured"

    @property
    def horizon(self) -> int:
        """Sampling periods that the window spans, 0 of an estimator without a window."""
        return int(getattr(self, "N", 0))

    def filters_exactly(self, s: Setting) -> bool:  # noqa: ARG002 - most never do
        """Whether of a linear model it is the Kalman filter, by covariances alone.

        But for bounds, turns and outliers, which others see; of a model with this setting.
        """
        return False

    @property
    def forgets(self) -> bool:
        """Whether no sample counts for ever, even of constants: the gain or the window ends it."""
        return self.constant_gain

    @property
    def one_sided(self) -> bool:
        """Whether at a kink of the model it takes the slope of one side for the other, too."""
        return False

    @property
    def judges_steps(self) -> bool:
        """Whether its optimiser ends by how much a step changes the cost."""
        return False

    @property
    def restrictions(self) -> tuple[str, ...]:
        """Names of the settings, among those that are given, that keep it from being Gaussian."""
        return tuple(name for name in ("limits", "soft") if getattr(self, name, None))

    @property
    def delay(self) -> int:
        """Samples from the newest one back to that of the output: the field ``lag``, or 0.

        A lag of "N" is the horizon.
        """
        lag = getattr(self, "lag", 0)
        return self.horizon if lag == "N" else int(lag)

    def variants(self) -> Mapping[str, AbstractEstimator]:
        """The estimator itself, first, and with other arrival costs; by their names."""
        return {"": self}

    @final
    def compile_watched(self, model: Model, dt: float) -> Recursion:
        """What `compile` makes, with a status that says when an impossible reading has misled it.

        See `backsight.estimators.around.misled`; errors are those of `compile`.
        """
        return watched(self.compile(model, dt), self, model)

    def inspect(self, model: Model, dt: float) -> Inspection:  # noqa: ARG002 - none has a window
        """Build the whole window of a sample, see `Inspection`.

        Raises
        ------
        TuningError
            If the estimator has no window whose states can be looked at.
        """
        raise TuningError(f"{self.title} has no window to look at; use MHE")

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """Turn the description into a pass forward and a pass back, see `backsight.smooth`.

        Parameters
        ----------
        model, dt
            As in `compile`.
        covariance : {"full", "std"}
            What to put out of the covariance.

        Raises
        ------
        TuningError, ModelError
            If the estimator has no smoother: it is no filter with a Gaussian prior at every sample;
            or if the description does not fit the model.
        """
        del model, dt, covariance
        raise TuningError(
            f"{self.title} has no smoother over a whole recording; with the same noise and prior "
            "smooth by KalmanFilter if the model is linear, else by EKF, IEKF or UKF, and unknown "
            'forces by JointInput (an MHE looks back over N samples with lag = "N")'
        )


ESTIMATE_CHANNELS = (
    Channel("x_hat", ("state",)),
    Channel("P", ("state", "state_"), symmetric=True),
    Channel("y_hat", ("output",)),
    Channel("e", ("output",)),
    Channel("S", ("output", "output_"), symmetric=True),
    Channel("status"),
)
"""Outputs that every estimator has, in this order."""
