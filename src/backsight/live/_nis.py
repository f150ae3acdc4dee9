r"""Normalised innovation squared of samples as they come, :math:`e^T S^{-1} e`.

With so many outputs that S is not put out, every output is taken for itself: the sum of
:math:`(e_i / \sigma_i)^2`, which has the same mean.
"""

import dataclasses

import numpy as np

from backsight.live.engine import LiveRows
from backsight.types import Array


def with_nis(rows: LiveRows) -> LiveRows:
    """Rows with ``nis`` and without ``S``; NaN where nothing was measured."""
    values = dict(rows.values)
    e, S = values["e"], values.pop("S", None)
    measured = np.isfinite(e)
    if S is not None:
        found = _whitened_squares(e, S, measured)
    elif "e_std" in values:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = np.nansum((e / values["e_std"]) ** 2, axis=1)
    else:
        found = np.full(len(rows), np.nan)
    values["nis"] = np.where(measured.any(axis=1), found, np.nan)
    return dataclasses.replace(rows, values=values)


def _whitened_squares(e: Array, S: Array, measured: np.ndarray) -> Array:
    """What was not measured is taken out by rows and columns of the unit matrix."""
    both = measured[:, :, None] & measured[:, None, :]
    one = np.eye(e.shape[1])
    sound = np.where(both, S, one)
    finite = np.asarray(np.isfinite(sound).all(axis=(1, 2)))
    sound = np.where(finite[:, None, None], sound, one)
    right = np.where(measured, e, 0.0)
    try:
        solved = np.linalg.solve(sound, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return np.full(len(e), np.nan)
    with np.errstate(over="ignore"):  # of a reading that no machine has
        return (right * solved).sum(axis=1)
