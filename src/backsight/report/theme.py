"""What all plots of the page look like: a plotly.js template whose colours are CSS variables."""

NONE = "rgba(0, 0, 0, 0)"
FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'

TEMPLATE: dict[str, object] = {
    "layout": {
        "font": {"family": FONT, "size": 11.5, "color": "--muted"},
        "paper_bgcolor": NONE,
        "plot_bgcolor": NONE,
        "margin": {"l": 52, "r": 10, "t": 26, "b": 36},
        "showlegend": False,
        "hovermode": "x unified",
        "hoverlabel": {
            "bgcolor": "--raised",
            "bordercolor": "--rule",
            "font": {"family": FONT, "size": 11.5, "color": "--ink"},
        },
        "xaxis": {
            "title": {"text": "time [s]", "standoff": 4},
            "showgrid": False,
            "zeroline": False,
            "showline": True,
            "linecolor": "--rule",
            "ticks": "outside",
            "ticklen": 4,
            "tickcolor": "--rule",
            "nticks": 8,
            "hoverformat": ".6~g",
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
    return {"text": text, **place, "yanchor": "bottom", "yshift": 5}


def remark(text: str) -> dict[str, object]:
    """A muted note above the right end of a plot."""
    place = {"xref": "paper", "x": 1, "xanchor": "right", "yref": "paper", "y": 1}
    font = {"size": 11, "color": "--muted"}
    return {"text": text, **place, "yanchor": "bottom", "yshift": 5, "font": font}
