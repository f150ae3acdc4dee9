"""Whether a sampling period is short enough for the vibrations of a model."""

from collections.abc import Sequence

import numpy as np
import scipy

from backsight.description import checked
from backsight.errors import ModelError
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.types import Array


@checked(ModelError)
def check_sampling(model: Model, dt: float) -> None:
    """Raise `ModelError` if a model vibrates faster than sampling can carry.

    A mode above half the sampling frequency (Nyquist) looks like one below it, so that measurements
    are attributed to the wrong motion. The message names every such mode and its frequency.
    Discrete-time models pass, they are from sample to sample already, and so do nonlinear ones,
    which have no frequencies of their own.

    Parameters
    ----------
    model : Model
    dt : float
        Sampling period [s].

    Examples
    --------
    >>> bs.check.check_sampling(bs.sdof(k=40.0, b=0.8), 0.05)  # says nothing: one period fits
    """
    if not model.continuous:
        return
    try:
        given = state_space(model)[0]
    except ModelError:
        return
    A, _ = scipy.linalg.matrix_balance(given, permute=False, separate=True)
    values, vectors = (np.asarray(v, complex) for v in np.linalg.eig(A))
    limit = 0.5 / dt
    fast = {
        float(abs(value)) / (2 * np.pi): np.abs(vector)
        for value, vector in zip(values, vectors.T, strict=True)
        if value.imag > 2 * np.pi * limit
    }
    if fast:
        names = [s.name for s in model.states]
        raise ModelError(
            f"model '{model.name}' has modes that sampling every {dt:g} s cannot carry: "
            + ", ".join(f"{f:.4g} Hz ({_moving(v, names)})" for f, v in sorted(fast.items()))
            + f"; the limit (Nyquist) is {limit:.4g} Hz: keep fewer modes or sample faster"
        )


def _moving(sizes: Array, names: Sequence[str]) -> str:
    """Names of the states that move most in a mode."""
    return ", ".join(n for n, v in zip(names, sizes, strict=True) if v > sizes.max() / 2)
