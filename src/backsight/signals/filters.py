"""Filters: a band-pass that emphasises a resonance, and a high-pass for whole recordings.

Source of the band-pass: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer
for vibration dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012,
section VI.B.
"""

import math

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from backsight.description import Positive, checked
from backsight.errors import BacksightError, DataError
from backsight.types import Array

ORDER = 2
"""Of the Butterworth filter."""

NOTE = "high_pass"
"""Attribute of a recording that was filtered: the cut-off frequency [Hz]."""


def bandpass(
    dt: float, *, cutoff: float = 100.0, frequency: float = 450.0, damping: float = 0.1
) -> tuple[Array, Array]:
    r"""High-pass of first order times resonant low-pass of second order, by Tustin's rule.

    .. math:: W_p(s) = \frac{s}{s + 2\pi f_{lc}}
              \frac{\omega_n^2}{s^2 + 2\zeta\omega_n s + \omega_n^2}, \quad \omega_n = 2\pi f_n

    The paper prints :math:`2\zeta\pi f_n s` for the damping term, which is half of what its text
    says; ``damping=0.05`` gives the filter as printed.

    Parameters
    ----------
    dt : float
        Sampling period [s].
    cutoff : float
        Lower cut-off frequency :math:`f_{lc}` [Hz].
    frequency : float
        Natural frequency :math:`f_n` [Hz].
    damping : float
        Damping ratio :math:`\zeta` [-].

    Returns
    -------
    b, a : (4,) arrays
        Numerator and denominator in powers of :math:`z^{-1}`, ``a[0] = 1``; see `filtered`.

    Raises
    ------
    BacksightError
        If an argument is not positive or a frequency is not below half the sampling rate.

    Examples
    --------
    >>> b, a = bs.signals.bandpass(1e-4)
    >>> b.shape, a.shape
    ((4,), (4,))
    """
    if not all(value > 0 for value in (dt, cutoff, frequency, damping)):
        raise BacksightError("bandpass: dt, cutoff, frequency and damping must be positive")
    if max(cutoff, frequency) >= 0.5 / dt:
        raise BacksightError(
            f"bandpass: {max(cutoff, frequency):g} Hz is not below half the sampling rate, "
            f"{0.5 / dt:g} Hz"
        )
    omega = 2 * math.pi * frequency
    b, a = scipy.signal.bilinear(
        [omega**2, 0.0],
        np.polymul([1.0, 2 * math.pi * cutoff], [1.0, 2 * damping * omega, omega**2]),
        fs=1 / dt,
    )
    return np.asarray(b, float), np.asarray(a, float)


@checked(DataError)
def filtered(values: ArrayLike, *, b: Array, a: Array) -> Array:
    """Filter signals along time, from rest.

    Use one filter for inputs and outputs: a linear model between them then stays as it is.

    Parameters
    ----------
    values : (n,) or (n, k) array
        Signals, time first.
    b, a : arrays
        Coefficients, as from `bandpass` or the design functions of `scipy.signal`.

    Raises
    ------
    DataError
        If a value is NaN or infinite: from there on, everything would be.

    Examples
    --------
    >>> import numpy as np
    >>> b, a = bs.signals.bandpass(1e-4)
    >>> bs.signals.filtered(np.zeros(5), b=b, a=a)
    array([0., 0., 0., 0., 0.])
    """
    values = np.asarray(values, float)
    wrong = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if wrong.any():
        raise DataError(
            f"filtered: sample {int(np.argmax(wrong))} is not finite; interpolate missing samples "
            f"before filtering"
        )
    return np.asarray(scipy.signal.lfilter(b, a, values, axis=0))


@checked(DataError)
def high_pass(recording: xr.Dataset, cutoff: Positive) -> xr.Dataset:
    """High-pass filter inputs, outputs and true states alike.

    Sensors of acceleration have offsets and drift, and what is integrated from them drifts with
    them. With the same filter on all signals a linear model with constant parameters holds between
    the filtered ones as it does between the others, so that estimators need not know of it. What
    they then find, states, unknown forces and virtual outputs, is without its slow part, too.

    Parameters
    ----------
    recording : xarray.Dataset
        Without gaps.
    cutoff : float
        Frequency at which a signal is 3 dB too small [Hz]; the filter is a causal Butterworth
        filter of the second order.

    Returns
    -------
    xarray.Dataset
        The filter starts as if all signals had stayed at their first value for ever; what is wrong
        with that fades within about ``1 / cutoff`` seconds.

    Raises
    ------
    DataError
        If the cut-off is not below half the sampling rate, or a sample is missing.

    Examples
    --------
    >>> import numpy as np
    >>> recording = bs.data.from_arrays(
    ...     y=5.0 + np.zeros((9, 1)), inputs={}, outputs={"a": "m/s2"}, dt=0.01
    ... )
    >>> abs(float(bs.signals.high_pass(recording, 0.5).y[-1, 0])) < 1e-9  # the mean is gone
    True
    """
    dt = float(recording.attrs["dt"])
    if cutoff >= 0.5 / dt:
        raise DataError(
            f"high_pass: {cutoff:g} Hz is not below half the sampling rate, {0.5 / dt:g} Hz"
        )
    sections = scipy.signal.butter(ORDER, cutoff, "highpass", fs=1 / dt, output="sos")
    signals = {name: recording[name] for name in ("u", "y", "x_true") if name in recording}
    for name, signal in signals.items():
        values = signal.values
        whole = np.isfinite(values)
        if not whole.all() and name != "x_true":
            k, j = np.argwhere(~whole)[0]
            raise DataError(
                f"high_pass: '{signal[signal.dims[1]].values[j]}' is missing at sample {k}; cut "
                "the recording there, or fill the gap first"
            )
        signals[name] = signal.copy(data=_settled(sections, values))
    return recording.assign(signals).assign_attrs({NOTE: float(cutoff)})


def _settled(sections: Array, values: Array) -> Array:
    """Signals (n, m) through the sections of a filter that was settled before the first sample."""
    if not values.shape[1]:
        return values
    settled = scipy.signal.sosfilt_zi(sections)[:, :, np.newaxis] * values[0]
    return np.asarray(scipy.signal.sosfilt(sections, values, axis=0, zi=settled)[0])
