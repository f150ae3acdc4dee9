"""Colours that people with any kind of colour vision can tell apart.

Source: Okabe, Ito, "Color Universal Design", 2008, https://jfly.uni-koeln.de/color/. The order
differs between light and dark: on each ground the colours with the strongest contrast come first.
Orange, sky and purple are too pale for lines on white (contrast below 3:1, WCAG 2.2, 1.4.11);
plum, brown and indigo take their places there.
"""

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
PLUM = "#B04A8C"
BROWN = "#7A5200"
INDIGO = "#4A2A7A"

ON_LIGHT = (BLUE, VERMILLION, GREEN, PLUM, BROWN, INDIGO)
ON_DARK = (SKY, ORANGE, GREEN, PURPLE, YELLOW, VERMILLION)
DASHES = ("solid", "dash", "dot")
"""Line styles that tell series apart when the colours are used up."""


def series_variables(colours: tuple[str, ...], *, band: float) -> str:
    """Return CSS declarations ``--series-0`` and ``--series-0-band`` and so on.

    Parameters
    ----------
    colours : tuple of str
        As ``#rrggbb``.
    band : float
        Opacity of the bands.
    """
    return " ".join(
        f"--series-{i}: {colour}; --series-{i}-band: {_transparent(colour, band)};"
        for i, colour in enumerate(colours)
    )


def _transparent(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity:g})"
