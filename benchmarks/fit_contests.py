"""Who competes on finding the noise from a recording."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks import fit_noise
from benchmarks.contest import Contender, Contest, Entry, peer

DEVIATIONS = "Noise of a linear oscillator by maximum likelihood, 3 standard deviations"
COVARIANCE = "The same, all of Q free"

BACKSIGHT = "Backsight"
FIRST = "Backsight, the first time: nothing kept"
STATSMODELS = "statsmodels, L-BFGS"
KALMAN_PY = "kalman-py, BFGS through JAX"


def contests() -> tuple[Contest, ...]:
    """Three standard deviations, and the sensor's with all of the covariance of the process."""
    return (
        Contest(
            DEVIATIONS,
            "ms per fit",
            (
                Entry(BACKSIGHT, partial(fit_noise.deviations, anew=False)),
                Entry(FIRST, partial(fit_noise.deviations, anew=True)),
                Entry(STATSMODELS, partial(_shares, peer("statsmodels_fit", "build"))),
            ),
            "2 states, 1 output, 3000 samples, started 5 to 10 times off, no prior, no checks; "
            "difference from Backsight as a share of a standard deviation. What is made of "
            "estimator and model before the first sample is kept for the next recording.",
        ),
        Contest(
            COVARIANCE,
            "ms per fit",
            (
                Entry(BACKSIGHT, fit_noise.covariance),
                Entry(KALMAN_PY, partial(_beside, peer("kalman_py_fit", "build"))),
            ),
            "4 values; one position does not tell the correlation of the steps, so that it is the "
            "logarithm of the likelihood that is compared.",
        ),
    )


def _shares(build: Callable[[], Contender]) -> Contender:
    """A contender whose standard deviations are compared with those of Backsight."""
    ours, theirs = fit_noise.deviations(anew=False).work(), build()
    return dataclasses.replace(
        theirs, work=lambda: theirs.work() / ours, expected=np.ones(ours.shape)
    )


def _beside(build: Callable[[], Contender]) -> Contender:
    """A contender whose likelihood is compared with that of Backsight."""
    return dataclasses.replace(build(), expected=fit_noise.covariance().work())
