"""The page of a fleet: one HTML file with its table, distributions and trends."""

import json
import math
import shlex
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import pandas as pd

from backsight.fleet.rows import BECAUSE, OUTLYING, judged, reading_store
from backsight.output import write_whole
from backsight.report.page import gzipped, style
from backsight.rounding import grouped

PAGE = "fleet.html"

MOST_ROWS = 50_000
"""Rows of a page. Of more, those that are off most are there, and of the rest every so many."""

OFF = 5.0
"""Robust deviations from which on a row counts as an outlier."""

DIGITS = 9
"""Of numbers on the page; the tables beside it have all of them."""


def write_fleet_page(store: Path, rows: pd.DataFrame) -> Path:
    """Write the page of a fleet into its folder.

    Parameters
    ----------
    store : Path
        Folder of `run_fleet`.
    rows : pandas.DataFrame
        From `read_rows`.

    Returns
    -------
    Path
        Where the page is.
    """
    with reading_store(store) as opened:
        about = opened.about
    shown = _thinned(rows)
    data = {
        "columns": [_column(shown[n], str(n), about) for n in _ordered([*shown.columns], about)],
        "axes": [*about["axes"], "estimator"],
        "judged": [name for name in judged(about) if name in shown],
        "store": shlex.quote(str(store)),
        "off": OFF,
    }
    page = Template(_view("view.html")).substitute(
        title=escape(about["title"]),
        style=style() + _view("view.css"),
        facts=escape(_facts(rows, shown)),
        rows=gzipped(json.dumps(data, separators=(",", ":"), allow_nan=False, ensure_ascii=False)),
        script=_view("view.js"),
    )
    return write_whole(store / PAGE, page.encode("utf-8"))


def _thinned(rows: pd.DataFrame) -> Any:
    if len(rows) <= MOST_ROWS:
        return rows
    order = np.argsort(-rows[OUTLYING].to_numpy(float), kind="stable")
    half = MOST_ROWS // 2
    rest = np.sort(order[half:])
    every = -(-len(rest) // half)
    return rows.iloc[np.sort(np.concatenate([order[:half], rest[::every]]))]


def _ordered(names: list[str], about: dict[str, Any]) -> list[str]:
    """What is looked for first, then the unknowns with their deviations, then the rest."""
    unknown = [name for name in judged(about) if name in about["states"]]
    first = ["recording", OUTLYING, BECAUSE, "failure", *about["axes"], "estimator"]
    first += [n for name in unknown for n in (name, f"{name}_std")]
    first = [name for name in dict.fromkeys(first) if name in names]
    return first + [name for name in names if name not in first]


def _facts(rows: pd.DataFrame, shown: pd.DataFrame) -> str:
    failed = int(np.count_nonzero(rows["failure"].to_numpy() != ""))
    off = int(np.count_nonzero(rows[OUTLYING].to_numpy(float) > OFF)) - failed
    facts = [f"{grouped(len(rows))} row{'s' * (len(rows) != 1)}", f"{grouped(failed)} failed"]
    facts.append(f"{grouped(off)} more than {OFF:g} deviations off the others")
    if len(shown) < len(rows):
        facts.append(
            f"this page has {grouped(len(shown))} of them, those that are off most and a part of "
            "the rest; rows.csv has all"
        )
    return " · ".join(facts)


def _column(values: pd.Series, name: str, about: dict[str, Any]) -> dict[str, Any]:
    """Numbers, dates or texts with what they are, as JSON takes them."""
    unit = about["states"].get(name) or about["states"].get(name.removesuffix("_std"), "")
    unit = unit or about["outputs"].get(name.removeprefix("rms_"), "") or _UNITS.get(name, "")
    kind = "hidden" if name == "item" else "text"
    if pd.api.types.is_numeric_dtype(values) and not pd.api.types.is_bool_dtype(values):
        kind, cells = "number", [_number(v) for v in values.to_numpy(float)]
    else:
        cells = ["" if v is None or v != v else str(v) for v in values.tolist()]
        if name not in _TEXTS and _are_dates(cells):
            kind = "date"
    return {"name": name, "unit": unit, "kind": kind, "values": cells}


_UNITS = {"dt": "s", OUTLYING: "σ"}
_TEXTS = ("recording", "estimator", "status", "failure", "remarks", BECAUSE, "item")


def _number(value: float) -> float | str | None:
    if math.isnan(value):
        return None
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return float(f"{value:.{DIGITS}g}")


def _are_dates(cells: list[str]) -> bool:
    """Whether these are dates as ISO 8601 writes them, which sort as text does."""
    some = [c for c in cells if c]
    if not some or not all(len(c) >= 10 and c[4:8:3] == "--" for c in some[:100]):
        return False
    try:
        pd.to_datetime(pd.Series(some), format="ISO8601")
    except (ValueError, TypeError):
        return False
    return True


def _view(name: str) -> str:
    return files("backsight.fleet").joinpath("view", name).read_text(encoding="utf-8")
