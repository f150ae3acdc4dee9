"""Run an estimator live, one sample at a time."""

import numpy as np

from backsight.engine.execute import stepper
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
    engine : {"native", "vm"}
        Machine code, or CasADi's virtual machine, which takes many times as long per sample but
        nothing to start.
    """

    def __init__(
        self, estimator: AbstractEstimator, model: Model, dt: float, *, engine: str = "native"
    ) -> None:
        self._model = model
        recursion = estimator.compile(model, dt)
        self._channels = recursion.channels
        self._stepper = stepper(recursion, engine)

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
            and ``status``; of an estimator that looks back, for the sample `lag` steps ago.

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
        values = self._stepper.step(data)
        return {
            c.name: c.unpack(v[np.newaxis])[0] for c, v in zip(self._channels, values, strict=True)
        }


def stream(
    estimator: AbstractEstimator, model: Model, dt: float, *, engine: str = "native"
) -> Stream:
    """Start an estimator on a live stream with sampling period dt [s]; see `Stream`."""
    return Stream(estimator, model, dt, engine=engine)
