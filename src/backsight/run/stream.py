"""Run an estimator live, one sample at a time."""

import numpy as np

from backsight.errors import DataError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.signals import vector
from backsight.types import Array, ByName


class Stream:
    """An estimator at work on a live stream; equal to `estimate` on the same samples.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    dt : float
        Sampling period [s].
    """

    def __init__(self, estimator: AbstractEstimator, model: Model, dt: float) -> None:
        self._model = model
        self._recursion = estimator.compile(model, dt)
        self._carry = self._recursion.carry0

    def step(self, u: ByName, y: ByName) -> dict[str, Array]:
        """Process one sample.

        Parameters
        ----------
        u, y : dict or sequence
            Inputs and outputs of the sample; an output that is NaN or left out of the dict was
            not measured.

        Returns
        -------
        dict
            The variables of a result for this sample, among them ``x_hat`` (nx,), ``P`` (nx, nx)
            and ``status``.

        Raises
        ------
        DataError
            If an input is missing or not finite.
        """
        nan = np.full(max(self._model.nu, self._model.ny), np.nan)
        inputs = vector(u, self._model.inputs, what="u", default=nan[: self._model.nu])
        outputs = vector(y, self._model.outputs, what="y", default=nan[: self._model.ny])
        if not np.all(np.isfinite(inputs)):
            raise DataError(f"input {inputs} is not finite; inputs must be known at every sample")
        measured = np.isfinite(outputs)
        data = [inputs, np.where(measured, outputs, 0.0), measured.astype(float)]
        carry, *values = self._recursion.step.call([self._carry, *data])
        self._carry = np.asarray(carry)[:, 0]
        return {
            c.name: c.unpack(np.asarray(v).T)[0]
            for c, v in zip(self._recursion.channels, values, strict=True)
        }


def stream(estimator: AbstractEstimator, model: Model, dt: float) -> Stream:
    """Start an estimator on a live stream with sampling period dt [s]; see `Stream`."""
    return Stream(estimator, model, dt)
