"""Results as a page to look at.

The package itself is imported together with `backsight`; what draws, only when something is drawn.
"""

from __future__ import annotations

import html
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

if os.name == "nt":
    from pathlib import WindowsPath as _Place
else:
    from pathlib import PosixPath as _Place

if TYPE_CHECKING:
    import xarray as xr


class ReportPath(_Place):
    """Where a report is; in a notebook it shows the page."""

    def _repr_html_(self) -> str | None:
        if self.suffix != ".html" or not self.is_file():
            return None
        text = self.read_text(encoding="utf-8")
        if "<script src=" in text:  # what is beside the file is not beside the notebook
            return None
        page = html.escape(text)
        style = "width: 100%; height: 48rem; border: 0"
        return f'<iframe srcdoc="{page}" title="{html.escape(self.stem)}" style="{style}"></iframe>'


def report(
    results: Mapping[str, xr.Dataset],
    path: str | os.PathLike[str],
    *,
    problem: str | Mapping[str, object] | None = None,
    title: str | None = None,
    reference: Mapping[str, float] | None = None,
    profiles: xr.Dataset | None = None,
    library: Literal["inside", "beside"] = "inside",
) -> ReportPath:
    """Write one self-contained HTML page that compares results; it opens without a network.

    Parameters
    ----------
    results : dict
        Name of the estimator to its result (see `backsight.schema`), of the same recording.
    path : path
        The page to write; missing folders are made.
    problem : str or dict, optional
        The problem as it was read, shown at the end.
    title : str, optional
        Heading; the name of the model if not given.
    reference : dict, optional
        Known value of some states or parameters [their units].
    profiles : xarray.Dataset, optional
        Of the fit that the results are from, see `backsight.tune.Tuned`.
    library : str
        Where the program that draws is: inside, so that the page is one file; or beside, in a file
        of 1.5 MB that all pages of a folder share.

    Returns
    -------
    ReportPath
        Where the page is; a notebook shows the page itself.

    Raises
    ------
    DataError
        If there is no result, a dataset is not one, or `reference` names an unknown state.
    OutputError
        If the page cannot be written; nothing is left behind then.

    Notes
    -----
    Long recordings are thinned for display to the smallest and largest value of every interval, so
    that every peak is there, and zooming in brings out the samples between. Beyond 1 MB of them
    they are thinned the same way. The tables use all samples.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 20, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> bs.report({"KF": bs.estimate(kf, spring, recording, engine="vm")}, "report.html").name
    'report.html'
    """
    from backsight.report.page import write_page

    page = write_page(
        results,
        path,
        problem=problem,
        title=title,
        reference=reference,
        profiles=profiles,
        library=library,
    )
    return ReportPath(page)
