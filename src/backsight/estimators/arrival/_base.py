"""What is known from before the window: the arrival cost, a part of an estimator to choose."""

import abc
import dataclasses
from collections.abc import Callable

import casadi as ca

from backsight.description import Description
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.scaled import Setting
from backsight.schema import Innovations
from backsight.solvers.trajectory import Chain
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Leaving:
    """What the window knows when its first sample leaves, all in scaled variables.

    Parameters
    ----------
    u, u_next, y, mask : MX
        Of the first sample; `u_next` of the second.
    along, along_next : MX
        First two states of the trajectory along which the stages are linearised.
    stage, stage_next : list of MX
        Description of the first two samples, see `Chain.sizes`.
    x_next : MX
        The second state given the whole window.
    P_next : callable
        Builds its covariance.
    """

    u: ca.MX
    u_next: ca.MX
    y: ca.MX
    mask: ca.MX
    along: ca.MX
    along_next: ca.MX
    stage: list[ca.MX]
    stage_next: list[ca.MX]
    x_next: ca.MX
    P_next: Callable[[], ca.MX]


@dataclasses.dataclass(frozen=True)
class Arrival:
    """An arrival cost for a model.

    Parameters
    ----------
    spread0 : array
        What is kept of the covariance, at the start.
    covariance : casadi.Function
        From that to the covariance as the window stores it.
    advance : callable
        ``(x, spread, leaving) -> [x, spread]`` when the first sample leaves the window.
    free : bool
        Once the window has moved, the prior goes along with the guess.
    """

    spread0: Array
    covariance: ca.Function
    advance: Callable[[ca.MX, ca.MX, Leaving], list[ca.MX]]
    free: bool = False


@dataclasses.dataclass(frozen=True)
class Fitting:
    """The model that an arrival cost is fitted to.

    Parameters
    ----------
    s : Setting
    integrator : Integrator
    Q : (nx, nx) array
        Covariance of the whole process noise per sample, scaled.
    chain : Chain
        The window; its process noise may be less.
    """

    s: Setting
    integrator: Integrator
    Q: Array
    chain: Chain


class AbstractArrival(Description, abc.ABC):
    """How the knowledge from before the window is summed up.

    While the window fills it is the estimator's prior. From then on its mean and covariance
    belong to the first sample of the window, before that sample's measurement.
    """

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`: white with the arrival cost of a Kalman filter."""
        return "white"

    @abc.abstractmethod
    def build(self, to: Fitting) -> Arrival:
        """Fit it to a model."""
