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
from backsight.plot._force_map import force_map
from backsight.plot._force_path import force_path_figure

__all__ = [
    "band",
    "figure",
    "force_map",
    "force_path_figure",
    "label",
    "legend",
    "line",
    "save",
    "truth",
]
