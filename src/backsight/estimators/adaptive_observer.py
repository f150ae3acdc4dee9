"""What the threshold of an adaptive gain needs of an observer."""

import abc

import casadi as ca

from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model


class AbstractAdaptiveObserver(AbstractEstimator):
    """An observer whose gain may follow the innovation of a window, see `AdaptiveGain`."""

    @abc.abstractmethod
    def fixed(self) -> "AbstractAdaptiveObserver":
        """The same with its largest gain all the time."""

    @abc.abstractmethod
    def window_innovation(self, model: Model, dt: float, length: int) -> ca.Function:
        """Innovation of a window that begins with an estimate [output unit * s].

        ``(x_hat, U, Y, M) -> (1,)``: the estimate as in a result, (nx,), inputs (nu, length + 1),
        outputs and masks (1, length + 1), all physical.

        Raises
        ------
        TuningError, ModelError
            If the observer does not fit the model.
        """
