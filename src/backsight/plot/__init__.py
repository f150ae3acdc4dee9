"""Static figures: one calm style, bands, maps of forces, and files that are whole or not there.

Needs matplotlib, which comes with ``pip install 'backsight[plot]'``; the interactive page of
`backsight.report` does without.
"""

import importlib.util

if importlib.util.find_spec("matplotlib") is None:
    raise ModuleNotFoundError(
        "backsight.plot draws with matplotlib, which is not installed: "
        "pip install 'backsight[plot]'",
        name="matplotlib",
    )

from backsight.plot._figures import band, figure, label, legend, line, save, truth
from backsight.plot._force_map import draw_forces, force_map
from backsight.plot._force_path import force_path_figure
from backsight.plot._quality import draw_comparison, draw_nis, draw_spectrum
from backsight.plot._recovery import draw_recovery
from backsight.plot._signals import (
    draw_innovations,
    draw_outputs,
    draw_states,
    draw_virtual,
    draw_window,
)

__all__ = [
    "band",
    "draw_comparison",
    "draw_forces",
    "draw_innovations",
    "draw_nis",
    "draw_outputs",
    "draw_recovery",
    "draw_spectrum",
    "draw_states",
    "draw_virtual",
    "draw_window",
    "figure",
    "force_map",
    "force_path_figure",
    "label",
    "legend",
    "line",
    "save",
    "truth",
]
