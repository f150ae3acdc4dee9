"""Calibrate the model from the recording itself, without the hammer's signal."""

import dataclasses

import numpy as np

from backsight.types import Array
from backsight_studies.frame_hammer.follow import SAMPLES, Piece
from backsight_studies.frame_hammer.rig import Axis
from backsight_studies.frame_hammer.window import Fit, Window

PIECES = 24
"""Windows that are used, evenly over the recording."""

ROUNDS = 4
"""Steps of Gauss and Newton's method at most."""

TRUST = 0.003, 0.03
"""Relative standard deviation of what is known of the frequencies, and of limit and cutoff."""

NOISE = 0.1
"""Standard deviation of a sample; sets the weight of what is known [m/s2]."""

RELATIVE_STEP = 1e-5
"""Of the numerical derivatives."""


def calibrated(axis: Axis, y: Array, free: list[Piece]) -> Axis:
    """Frequencies, limit and cutoff that fit free windows of a recording best.

    Parameters
    ----------
    axis : Axis
        Start.
    y : (n, 4) array
        Recording [m/s2].
    free : list of Piece
        Motion without hits, found with `axis`.
    """
    if not free:
        return axis
    chosen = [free[i] for i in np.unique(np.linspace(0, len(free) - 1, PIECES).astype(int))]
    signals = [np.ascontiguousarray(y[p.start : p.start + SAMPLES].T, float) for p in chosen]
    fits, logs = [p.fit for p in chosen], np.zeros(axis.modes + 2)
    known = np.array([TRUST[0]] * axis.modes + [TRUST[1]] * 2) / NOISE
    for _ in range(ROUNDS):
        step = _step(_changed(axis, logs), signals, fits, known, logs)
        tried = _refit(_changed(axis, logs + step), signals, fits)
        if _cost(tried, logs + step, known) > 0.999 * _cost(fits, logs, known):
            break
        fits, logs = tried, logs + step
    return _changed(axis, logs)


def _changed(axis: Axis, logs: Array) -> Axis:
    """The axis with frequencies, limit and cutoff times the exponential of `logs`."""
    factors = np.exp(logs)
    return dataclasses.replace(
        axis,
        frequencies=tuple(np.array(axis.frequencies) * factors[:-2]),
        limit=float(axis.limit * factors[-2]),
        cutoff=float(axis.cutoff * factors[-1]),
    )


def _step(axis: Axis, signals: list[Array], fits: list[Fit], known: Array, logs: Array) -> Array:
    """Step of the shared quantities; the motion of every window is eliminated."""
    n = len(logs)
    window = Window(axis, SAMPLES)
    moved = [Window(_changed(axis, d), SAMPLES) for d in RELATIVE_STEP * np.eye(n)]
    normal, slope = np.diag(known**-2.0), -logs / known**2
    for y, fit in zip(signals, fits, strict=True):
        left = window.residual(y, window.free, fit.unknowns).ravel()
        rows = (
            np.stack([left - m.residual(y, m.free, fit.unknowns).ravel() for m in moved])
            / RELATIVE_STEP
        )
        basis = np.linalg.qr(window.jacobian(window.free, fit.unknowns).T)[0]
        rows, left = rows - rows @ basis @ basis.T, left - basis @ (basis.T @ left)
        normal, slope = normal + rows @ rows.T, slope + rows @ left
    return np.asarray(np.linalg.solve(normal, slope), float)


def _refit(axis: Axis, signals: list[Array], fits: list[Fit]) -> list[Fit]:
    window = Window(axis, SAMPLES)
    return [window.fit(y, fit, iterations=6) for y, fit in zip(signals, fits, strict=True)]


def _cost(fits: list[Fit], logs: Array, known: Array) -> float:
    return sum(fit.cost for fit in fits) + float(((logs / known) ** 2).sum())
