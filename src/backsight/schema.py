"""Names, dimensions and status codes of every dataset: the only place where they are spelled.

A *recording* has ``u (time, input)`` and ``y (time, output)``; ``NaN`` in ``y`` is "not measured".
It may have ``sigma_factor (time, output)``: the standard deviation of the sample's noise by the
nominal one, the estimator's ``sigma_y``; ``NaN`` and infinity are "not measured", too.
A *result* has, beside the recording's ``u`` and ``y``, the variables of `RESULT_VARIABLES`.
The virtual outputs of its model are ``z_hat`` and ``z_std (time, virtual)``, see
`backsight.models.views.virtual`, and ``z_true`` where it is known.
Units are coordinates: ``input_unit``, ``output_unit``, ``state_unit``. The unknown forces of a
result, ``d_hat (time, force)``, have ``force_unit``, and ``force_position`` if that is known.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from backsight.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

SCHEMA_VERSION = 1

RESULT_VARIABLES = {
    "x_hat": (("time", "state"), "estimate after the sample's measurement"),
    "x_std": (("time", "state"), "standard deviation of x_hat"),
    "P": (("time", "state", "state_"), "covariance of x_hat"),
    "y_hat": (("time", "output"), "output computed from x_hat"),
    "e": (("time", "output"), "innovation: measurement minus its one-step prediction"),
    "S": (("time", "output", "output_"), "covariance of the innovation"),
    "status": (("time",), "bits of Status"),
}

VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE = "z_hat", "z_std", "z_true"
"""Variables of a result with virtual outputs, ``(time, virtual)``: quantities without a sensor."""

SAME = 1e-6
"""Times closer than this, in periods, are the same time."""

CHANGE = "d_"
"""In front of the name of a signal whose change from sample to sample is meant."""

AGO = "ago"
"""Attribute of a variable that is held between the samples: number of samples from the one of a row
back to where the interval begins that it is about; 0 if not there."""


Innovations = Literal["white", "coloured", "forced"]
"""What the innovations of an estimator are if its model and its noise are right.

``white``
    Independent of each other: the gain is that of the Kalman filter.
``coloured``
    As large as predicted, but correlated, because the gain is another one.
``forced``
    They contain forces that are not known yet: without these, as large as predicted.
"""

INNOVATIONS = "innovations"
"""Attribute of a result with the `Innovations` of its estimator; "white" if it is not there."""


class Status(enum.IntFlag):
    """What happened at a sample; zero is "nothing to report"."""

    OK = 0
    CLIPPED = 1
    ITERATION_LIMIT = 2
    STEP_REJECTED = 4
    NOT_POSITIVE_DEFINITE = 8
    NOT_FINITE = 16
    NOT_EXCITED = 32
    UNDEFINED = 64
    UNOBSERVED = 128
    INFEASIBLE = 256
    DEPENDENT = 512
    COARSE_STEP = 1024
    GATE_OPEN = 2048
    NOT_SOLVED = 4096
    TURN_GUESSED = 8192
    REDUNDANT = 16384
    MISLED = 32768
    NOT_OPTIMAL = 65536


STATUS_TEXT = {
    Status.CLIPPED: (
        "an estimate was set to its bound; if this happens often, the bound or the model is wrong"
    ),
    Status.ITERATION_LIMIT: (
        "the optimiser reached its iteration limit; raise max_iterations or check the start values"
    ),
    Status.STEP_REJECTED: (
        "the optimiser found no step that lowers the cost; check the start values and the scales"
    ),
    Status.NOT_POSITIVE_DEFINITE: (
        "a covariance lost positive definiteness; use the default covariance propagation "
        "or more sub-steps"
    ),
    Status.NOT_FINITE: (
        "the estimate is no longer finite, or beyond all reason: the filter diverged; use more "
        "sub-steps, a better start value, or a smaller initial covariance"
    ),
    Status.NOT_EXCITED: (
        "a parameter moves the output less than the measurement noise over the window; it cannot "
        "be estimated from this motion, so excite the machine more"
    ),
    Status.UNDEFINED: (
        "a combination of parameters passed through zero, so that a parameter is undefined; its "
        "last value is kept; lower the gain or start nearer"
    ),
    Status.UNOBSERVED: (
        "the measurements in the window do not determine the state, so that the estimate leans on "
        "what was known before; lengthen the window or measure more often"
    ),
    Status.INFEASIBLE: (
        "no trajectory satisfies all constraints; the estimate is the one without them, and the "
        "variable 'infeasible' names the constraints that contradict each other"
    ),
    Status.COARSE_STEP: (
        "the integration step is too coarse for the modes of the model, so that the estimates are "
        "wrong by what it loses; use substeps = 'auto'"
    ),
    Status.DEPENDENT: (
        "several places or moments of a force explain the measurements equally well to rounding, "
        "so that one of them was left out; a sensor more, or fewer places, would tell them apart"
    ),
    Status.GATE_OPEN: (
        "most samples of an output looked like outliers, so that they were taken in after all; its "
        "noise, the model or the prior is wrong, or the sensor failed for longer than `patience`"
    ),
    Status.NOT_SOLVED: (
        "the equations of the model or of an implicit integration step were not solved, so that "
        "the estimate rests on a wrong model; give a better guess, or take more sub-steps"
    ),
    Status.TURN_GUESSED: (
        "an angle was not known to within half a turn before it was measured, so that the number "
        "of its turns was guessed; measure more often, or give a narrower prior"
    ),
    Status.REDUNDANT: (
        "a sensor without noise read what was known exactly already, so that its sample was left "
        "out; give it its sigma_y, or the states a random walk, if what it reads is different"
    ),
    Status.MISLED: (
        "constants have learned from a reading that was more than a hundred standard deviations "
        "from what was expected, and are worthless from there on; give the noise a rule for "
        'outliers, Gate() (outliers.kind = "Gate"), or start anew from the prior (restart)'
    ),
    Status.NOT_OPTIMAL: (
        "the optimum of a window is known only to a duality gap of more than 1e-9 of its cost, by "
        "rounding; raise lam, or state the noise as it is"
    ),
}
"""Cause and remedy of every status bit."""

ROLE = "state_role"
"""Coordinate of the states of a result: `UNKNOWN`, or "motion"."""

LOWER, UPPER = "state_lower", "state_upper"
"""Coordinates of the states of a result, their bounds; there if one of them is finite."""

UNKNOWN = "unknown"
"""Role of a state that the model leaves as it is: an unknown constant, parameter or force."""

SIGMA_FACTOR = "sigma_factor"
"""Variable of a recording with the noise of single samples."""

WEIGHT = "weight"
"""Variable of a result: weight of every sample by a rule for outliers, ``(time, output)``: 1 in
full, 0 left out; between, its noise was taken so much larger. NaN where not measured."""

SMALLEST_FACTOR = 1e-6
"""A smaller one would make a sample exact beside the others."""

EVERY = "every"
"""Attribute of a result of which only every so many samples were kept; not there if it is all."""

INTEGRATION = "integration"
"""Attribute of a result: how the model was carried from sample to sample."""

POSITIVE = "positive"
"""Attribute of a result: names of the states that are estimated as logarithms. Such a result has
the ends of the bands of one standard deviation, ``x_low`` and ``x_high (time, state)``."""

CULPRIT = "culprit"
"""Attribute of a result that is not finite: which equation of the model was not, and where."""

COARSE = "coarse_step"
"""Attribute of a result: why the integration step is too coarse, if it is."""

FAILURES = Status.NOT_FINITE
"""The bits after which the estimates are worthless; the driver raises on them."""


def recording(
    time: np.ndarray,
    *,
    u: np.ndarray,
    y: np.ndarray,
    inputs: dict[str, str],
    outputs: dict[str, str],
    dt: float,
) -> xr.Dataset:
    """Assemble a recording.

    Parameters
    ----------
    time : (n,) array
        Time of every sample [s], increasing.
    u : (n, nu) array
        Inputs.
    y : (n, ny) array
        Outputs; ``NaN`` means "not measured".
    inputs, outputs : dict
        Name to unit of every column.
    dt : float
        Sampling period [s].
    """
    import xarray as xr

    n = len(time)
    return xr.Dataset(
        {
            "u": (("time", "input"), np.asarray(u, float).reshape(n, len(inputs))),
            "y": (("time", "output"), np.asarray(y, float).reshape(n, len(outputs))),
        },
        coords={
            "time": ("time", np.asarray(time, float), {"units": "s"}),
            "input": list(inputs),
            "output": list(outputs),
            "input_unit": ("input", list(inputs.values())),
            "output_unit": ("output", list(outputs.values())),
        },
        attrs={"dt": float(dt), "schema": SCHEMA_VERSION},
    )


def check_sigma_factor(factor: np.ndarray, names: Sequence[str], where: str) -> None:
    """Raise `DataError` unless the factors (n, ny) are at least `SMALLEST_FACTOR` or NaN."""
    bad = np.argwhere(factor < SMALLEST_FACTOR)
    if len(bad):
        k, i = bad[0]
        raise DataError(
            f"{where}: {SIGMA_FACTOR} of output '{names[i]}' is {factor[k, i]:g} at sample {k}; it "
            f"must be {SMALLEST_FACTOR:g} or more (1 is the nominal noise), or NaN where not "
            "measured"
        )


def check_result(result: xr.Dataset) -> None:
    """Raise `DataError` unless the dataset has the variables and dimensions of a result."""
    check_estimates(result, "the dataset")
    if "P" not in result:
        raise DataError("the dataset has no variable 'P': it is not a result")


def check_estimates(result: xr.Dataset, where: str) -> None:
    """Raise `DataError` unless this is a result, with the covariance or without it."""
    for name, (dims, _) in RESULT_VARIABLES.items():
        if name == "P" and name not in result:
            continue
        if name not in result:
            kept = " with all that is asked of it (outputs=)" if "status" in result else ""
            raise DataError(f"{where} has no variable '{name}': it is not a result{kept}")
        if result[name].dims != dims:
            raise DataError(f"variable '{name}' has the dimensions {result[name].dims}, not {dims}")
