"""kalman-py: its learner of Q and R, BFGS through a filter in JAX."""

import jax
import numpy as np
from kalman_py.learning import fit_noise as learn

from backsight.types import Array
from benchmarks import fit_noise
from benchmarks.contest import Contender


def build() -> Contender:
    """R and all of Q; what is put out is the likelihood."""
    jax.config.update("jax_enable_x64", True)
    A, _ = fit_noise.transition()
    back = np.linalg.inv(A)
    # Its prior is one sample earlier, before the first prediction.
    before = fit_noise.SIGMA_X0**2 * back @ back.T
    first = list(fit_noise.START.values())

    def work() -> Array:
        found = learn(
            A, np.array([[1.0, 0.0]]), fit_noise.unforced(), np.zeros(2), before,
            Q0=np.diag(np.square(first[1:])), R0=np.array([[first[0] ** 2]]), method="gradient",
        )  # fmt: skip
        return np.array([[found.log_likelihood]])

    return Contender(work, fit_noise.PER_FIT)
