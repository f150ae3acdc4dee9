"""Run an estimator live, one sample at a time."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.description import Positive, checked
from backsight.engine.execute import Engine, stepper
from backsight.errors import DataError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.signals import Signal, vector
from backsight.schema import SIGMA_FACTOR, check_sigma_factor
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
    restart : bool
        After a sample whose estimate is not finite start anew from the prior.
    """

    def __init__(
        self,
        estimator: AbstractEstimator,
        model: Model,
        dt: float,
        *,
        engine: Engine = "native",
        restart: bool = False,
    ) -> None:
        self._estimator, self._model = estimator, model
        self._made_of = (estimator, model, dt, engine, restart)
        recursion = estimator.compile_watched(model, dt)
        recursion = recursion.restarting() if restart else recursion
        self._channels = recursion.channels
        self._stepper = stepper(recursion, engine)
        self._fresh = self.save()

    def __repr__(self) -> str:
        _, model, dt, engine, _ = self._made_of
        names = ", ".join(s.name for s in model.states)
        return f"Stream of {self._estimator.title}, {engine}, every {dt:g} s: {names}"

    def step(self, u: ByName, y: ByName, *, sigma_factor: ByName | None = None) -> dict[str, Array]:
        """Process one sample.

        Parameters
        ----------
        u, y : dict or sequence
            Inputs and outputs of the sample; an output that is NaN or left out of the dict was
            not measured.
        sigma_factor : dict or sequence, optional
            Outputs whose noise is not the nominal one to its standard deviation by `sigma_y`.

        Returns
        -------
        dict
            The variables of a result for this sample, among them ``x_hat`` (nx,), ``P`` (nx, nx)
            and ``status``; of an estimator that looks back, for the sample `lag` steps ago.

        Raises
        ------
        DataError
            If an input is missing or not finite, a factor is not positive, or the estimator cannot
            take it into account.
        """
        nan = np.full(self._model.nu, np.nan)
        inputs = vector(u, self._model.inputs, what="u", default=nan)
        outputs = self._measured(y)
        if not np.all(np.isfinite(inputs)):
            names = [s.name for s in self._model.inputs]
            lacking = ", ".join(n for n, v in zip(names, inputs, strict=True) if not np.isfinite(v))
            raise DataError(
                f"input {lacking} is not finite or missing; inputs must be known at every sample, "
                f"or be among the states: augment(model, inputs=['{lacking}'])"
            )
        factors = self._factors(sigma_factor)
        measured = np.isfinite(outputs) & np.isfinite(factors)
        mask = np.where(measured, 1 / np.where(measured, factors, 1.0), 0.0)
        data = [inputs, np.where(measured, outputs, 0.0), mask]
        values = self._stepper.step(data)
        return {
            c.name: c.unpack(v[np.newaxis])[0] for c, v in zip(self._channels, values, strict=True)
        }

    def _measured(self, y: ByName) -> Array:
        """Outputs (ny,), NaN where not measured; a sequence has those that a sensor has."""
        missing = [np.nan if s.dummy is None else s.dummy for s in self._model.outputs]
        values = np.array(missing, float)
        real = [i for i, s in enumerate(self._model.outputs) if s.dummy is None]
        signals = [self._model.outputs[i] for i in real]
        values[real] = vector(y, signals, what="y", default=values[real])
        return values

    def named(self, sample: Mapping[str, Array], variable: str = "x_hat") -> dict[str, float]:
        """Return one variable of a sample by the names of its states, outputs or forces.

        Parameters
        ----------
        sample : dict
            From `step`.
        variable : str
            One with a number for each name, such as ``x_hat``, ``y_hat``, ``e`` or ``d_hat``.

        Raises
        ------
        DataError
            If the sample has no such variable.
        """
        known = {c.name: c for c in self._channels if len(c.dims) == 1}
        if variable not in known:
            raise DataError(f"a sample has no '{variable}' by name, {nearest(variable, known)}")
        channel = known[variable]
        names = channel.labels or [s.name for s in self._signals()[channel.dims[0]]]
        return dict(zip(map(str, names), map(float, sample[variable]), strict=True))

    def _signals(self) -> dict[str, tuple[Signal, ...]]:
        return {"state": self._model.states, "output": self._model.outputs}

    def save(self) -> Array:
        """Return the memory, (nc,): all that the next sample needs of those before it."""
        return np.array(self._stepper.carry, dtype=float)

    def restore(self, memory: Array) -> None:
        """Go on from a memory that `save` returned, of a stream of the same make.

        Raises
        ------
        DataError
            If the memory is that of another estimator or model.
        """
        kept = np.asarray(memory, dtype=float)
        if kept.shape != self._fresh.shape:
            raise DataError(
                f"a memory of shape {kept.shape} is not from this stream, whose memory has "
                f"{self._fresh.size} numbers"
            )
        self._stepper.carry[:] = kept

    def reset(self) -> None:
        """Begin anew from the prior."""
        self.restore(self._fresh)

    def __getstate__(self) -> dict[str, object]:
        return {"made_of": self._made_of, "memory": self.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        estimator, model, dt, engine, restart = state["made_of"]
        self.__init__(estimator, model, dt, engine=engine, restart=restart)
        self.restore(state["memory"])

    def _factors(self, given: ByName | None) -> Array:
        """Factors of the noise of all outputs, (ny,)."""
        nominal = np.ones(self._model.ny)
        if given is None:
            return nominal
        if not self._estimator.weighs:
            raise DataError(
                f"{self._estimator.title} cannot take the noise of single samples into account; "
                f"use one that can, such as EKF, or leave out '{SIGMA_FACTOR}'"
            )
        outputs = self._model.outputs
        factors = vector(given, outputs, what=SIGMA_FACTOR, default=nominal)
        check_sigma_factor(factors[np.newaxis], [s.name for s in outputs], "sample")
        return factors


@checked()
def stream(
    estimator: AbstractEstimator,
    model: Model,
    dt: Positive,
    *,
    engine: Engine = "native",
    restart: bool = False,
) -> Stream:
    """Start an estimator on a live stream with sampling period dt [s]; see `Stream`.

    Examples
    --------
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0))
    >>> live = bs.stream(kf, bs.sdof(k=40.0, b=0.8), 0.05, engine="vm")
    >>> step = live.step([1.0], [0.02])
    >>> print(f"{step['x_hat'][0]:.3f} m")
    0.020 m
    """
    return Stream(estimator, model, dt, engine=engine, restart=restart)
