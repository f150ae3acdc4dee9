"""The path of sparse forces over the weight of the l1 norm as a figure."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from backsight.plot._figures import INK, figure, label, legend
from backsight.report.palette import ON_LIGHT

NAMED = 6
"""Atoms that get a colour and a name; the others are drawn in grey."""

_OTHERS = "#c9cdd1"


def force_path_figure(path: xr.Dataset, *, lam: float | None = None, unit: str = "N") -> Figure:
    """Draw the factors of all atoms, and what remains unexplained, over the weight.

    Parameters
    ----------
    path : xarray.Dataset
        From `trace_force_path`.
    lam : float, optional
        A weight to mark.
    unit : str
        Of the factors.

    Returns
    -------
    matplotlib.figure.Figure
        To be written by `backsight.plot.save`.
    """
    made = figure(2, height=2.6)
    forces, rest = made.axes
    weights, alpha = path["lam"].values, path["alpha"].values
    # What stays over a long stretch of weights is of interest, not what is large at its end.
    stretch = np.abs(alpha[1:] * np.diff(np.log(weights))[:, None]).sum(axis=0)
    order = np.argsort(stretch)[::-1]
    for i in order[NAMED:]:
        forces.plot(weights, alpha[:, i], color=_OTHERS, linewidth=0.8)
    for series, i in enumerate(order[:NAMED]):
        atom = path.isel(atom=i)
        name = f"{atom['place'].item()} at {atom['moment'].item():.4g} s"
        forces.plot(weights, alpha[:, i], color=ON_LIGHT[series % len(ON_LIGHT)], label=name)
    label(forces, "Forces", unit)
    legend(forces)
    rest.plot(weights, path["chi2"].values, color=ON_LIGHT[0], label="squared innovations")
    rest.step(weights, path["nonzeros"].values, color=ON_LIGHT[1], label="number of forces")
    rest.axhline(path.attrs["measured"], color=_OTHERS, linewidth=1.0, label="measurements")
    rest.set_yscale("symlog", linthresh=1.0)
    rest.set_ylim(bottom=0)
    label(rest, "What remains, and how many forces it takes", x="weight of the l1 norm")
    legend(rest)
    for axes in made.axes:
        axes.set_xscale("log")
        axes.set_xlim(weights[0], weights[-1])
        if lam is not None:
            axes.axvline(lam, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    return made
