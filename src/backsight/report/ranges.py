"""Vertical ranges that show what matters."""

import numpy as np

from backsight.types import Array


def view(lines: list[Array], bands: list[Array]) -> list[float] | None:
    """Vertical range that shows the lines whole and does not let a wide initial band squash them.

    Parameters
    ----------
    lines : list of array
        Signals and reference values. Of one that starts far away from where it is later, the first
        2 % of the samples do not count; a later peak always does.
    bands : list of array
        Limits of bands: the outermost 5 % of their samples do not count.

    Returns
    -------
    list of float, or None
        Lower and upper end; None if nothing is finite.
    """
    ranges = [r for v in lines if (r := _line_range(v))]
    ranges += [(q[0], q[1]) for v in bands if (q := _quantiles(v, 0.05))]
    if not ranges:
        return None
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return [low - margin, high + margin]


def bulk(values: Array) -> Array:
    """Range of the finite values without the outermost 0.5 % on either side: (2,), or empty."""
    return np.array(_quantiles(values, 0.005) or [])


def _line_range(values: Array) -> tuple[float, float] | None:
    whole, later = (_quantiles(v, 0.0) for v in (values, values[len(values) // 50 :]))
    if whole is None or later is None:
        return whole
    far = later[1] > later[0] and whole[1] - whole[0] > 5.0 * (later[1] - later[0])
    return later if far else whole


def _quantiles(values: Array, tail: float) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = np.quantile(finite, [tail, 1.0 - tail])
    return float(low), float(high)
