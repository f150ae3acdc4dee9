"""What all plots of the page look like: a plotly.js template whose colours are CSS variables."""

FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
_LEFT = 62  # pixels between the left edge of a figure and its axis

TEMPLATE: dict[str, object] = {
    "layout": {
        "font": {"family": FONT, "size": 11.5, "color": "--muted"},
        "paper_bgcolor": "--paper",
        "plot_bgcolor": "--paper",
        "margin": {"l": _LEFT, "r": 10, "t": 30, "b": 36},
        "showlegend": False,
        "hovermode": "x unified",
        "modebar": {"bgcolor": "--paper", "color": "--muted", "activecolor": "--ink"},
        "hoverlabel": {
            "bgcolor": "--raised",
            "bordercolor": "--rule",
            "font": {"family": FONT, "size": 11.5, "color": "--ink"},
        },
        "xaxis": {
            "title": {"text": "time [s]", "standoff": 4, "font": {"size": 11.5}},
            "showgrid": False,
            "zeroline": False,
            "showline": True,
            "linecolor": "--rule",
            "ticks": "outside",
            "ticklen": 4,
            "tickcolor": "--rule",
            "nticks": 8,
            "unifiedhovertitle": {"text": "%{x:.6~g} s"},
            "spikecolor": "--rule",
            "spikethickness": 1,
            "spikedash": "solid",
        },
        "yaxis": {
            "gridcolor": "--grid",
            "zeroline": False,
            "nticks": 6,
            "exponentformat": "power",
            "automargin": "width",
        },
        "annotationdefaults": {"showarrow": False, "font": {"size": 12.5, "color": "--ink"}},
    }
}


def heading(text: str, *, y: float = 1.0) -> dict[str, object]:
    """A label above the left end of a plot: it names the vertical axis without turning the head.

    Parameters
    ----------
    text : str
        Already safe for plotly.js.
    y : float
        Upper edge of the plot, as a share of the figure.
    """
    place = {"xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": y}
    return {"text": text, **place, "yanchor": "bottom", "xshift": -_LEFT, "yshift": 8}


def remark(text: str) -> dict[str, object]:
    """A muted note above the right end of a plot."""
    place = {"xref": "paper", "x": 1, "xanchor": "right", "yref": "paper", "y": 1}
    font = {"size": 11, "color": "--muted"}
    return {"text": text, **place, "yanchor": "bottom", "yshift": 8, "font": font}
