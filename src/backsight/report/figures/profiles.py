"""How sharply a tuning criterion tells its values: a small drawing each, without a script."""

from html import escape

import numpy as np
import xarray as xr

from backsight.rounding import significant
from backsight.types import Array

NOTE = (
    "<p>By how much the criterion grows if a value is moved and the others follow. Of a "
    "likelihood, the dashed line marks the ends of a 95 % interval; a curve that stays below it on "
    "one side says that the recording does not tell the value on that side.</p>"
)
WIDTH, HEIGHT, EDGE = 220, 120, 18  # of a drawing [pixels]
LIMIT, HIGHEST = 1.92, 6.0


def profile_drawings(profiles: xr.Dataset) -> str:
    """Curves of ``rise (name, point)`` over ``value (name, point)``, see `Tuned.profiles`."""
    each = [profiles.sel(name=name) for name in profiles["name"].values]
    drawn = [_drawing(str(p["name"].item()), p["value"].values, p["rise"].values) for p in each]
    return f'{NOTE}<div class="profiles">{"".join(drawn)}</div>'


def _drawing(name: str, value: Array, rise: Array) -> str:
    order = np.argsort(value)
    value, rise = value[order], np.clip(rise[order], 0, HIGHEST)
    shown = np.log(value) if (value > 0).all() else value
    span = float(shown[-1] - shown[0]) or 1.0
    x = EDGE + (WIDTH - 2 * EDGE) * (shown - shown[0]) / span
    points = " ".join(f"{a:.1f},{_height(b):.1f}" for a, b in zip(x, rise, strict=True))
    left, right, limit = EDGE, WIDTH - EDGE, _height(LIMIT)
    ends = [
        f'<text x="{at}" y="{HEIGHT - 3}" text-anchor="{anchor}">{significant(float(v), 2)}</text>'
        for at, anchor, v in ((left, "start", value[0]), (right, "end", value[-1]))
    ]
    label = f"rise of the criterion over {escape(name)}"
    return (
        f'<svg role="img" aria-label="{label}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-size="11" fill="currentColor"><text x="{left}" y="12">{escape(name)}</text>'
        f'<line x1="{left}" x2="{right}" y1="{limit:.1f}" y2="{limit:.1f}" '
        'stroke="currentColor" stroke-opacity="0.5" stroke-dasharray="4 3"/>'
        f'<polyline points="{points}" fill="none" stroke="currentColor" stroke-width="1.5"/>'
        f"{''.join(ends)}</svg>"
    )


def _height(rise: float) -> float:
    """Place on the drawing, from above."""
    low, high = HEIGHT - EDGE, EDGE
    return low - (low - high) * rise / HIGHEST
