"""The rows of a fleet as a table, and how far each lies from the others like it."""

import io
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backsight.errors import OutputError
from backsight.fleet.rows.numbers import nis_ratio_of
from backsight.fleet.rows.store import Entry, reading_store
from backsight.output import write_whole

LAST = ("samples", "dt", "nis_ratio", "log_likelihood")
"""Columns of numbers behind those of states and outputs."""

OUTLYING, BECAUSE = "outlying", "outlying_in"
"""Columns that say by how many robust deviations a row is off, and in which column most."""

NORMAL = 1.4826
"""Standard deviation of a normal density by its median absolute deviation."""


def read_rows(store: str | os.PathLike[str]) -> pd.DataFrame:
    r"""Read the table of a fleet, also while it is still running.

    Parameters
    ----------
    store : path
        Folder of `run_fleet`.

    Returns
    -------
    pandas.DataFrame
        A row for each recording, setting and estimator, in the order of the fleet file. Columns:
        ``recording``; the keys of the sweep; what the table of recordings says; ``estimator``;
        every state after the last sample, with its standard deviation in ``STATE_std``;
        ``rms_OUTPUT``, the size of the innovations; ``samples``, ``dt`` [s]; ``nis_ratio``, the
        mean NIS by its expectation; ``log_likelihood``, its mean; ``status``, what the status says
        of how many samples; ``failure``, why there is no estimate, else empty; ``remarks`` on the
        recording; ``outlying``, by how many robust standard deviations (median and median absolute
        deviation over the recordings with the same setting and estimator) unknowns, innovations or
        NIS are off at most, and ``outlying_in``, which of them; ``item``, by which
        ``backsight report`` finds the row.

    Raises
    ------
    DataError
        If the folder is not that of a fleet.

    Examples
    --------
    >>> from pathlib import Path
    >>> spring = '''
    ... recording = { path = "-", time = "t", inputs.u = "F", outputs.y = "q" }
    ... model = { kind = "sdof", k = 40.0, b = 1.0 }
    ... noise.sigma_y.y = 1e-3
    ... estimators.KF.kind = "kf"
    ... prior.sigma_x0 = { q = 0.1, v = 0.1 }
    ... '''
    >>> _ = Path("spring.toml").write_text(spring)
    >>> _ = Path("run_1.csv").write_text("t,F,q\n0,1,0\n1,1,1\n")
    >>> _ = Path("fleet.toml").write_text('problem = "spring.toml"\nrecordings.files = "run*.csv"')
    >>> _ = bs.fleet.run_fleet(bs.fleet.load_fleet("fleet.toml"), "store", workers=0)
    >>> bs.fleet.read_rows("store")["samples"].tolist()
    [2]
    """
    with reading_store(Path(store)) as opened:
        about = opened.about
        table = pd.DataFrame([_flat(entry, about) for entry in opened.rows()])
    if table.empty:
        return pd.DataFrame({name: [] for name in ("recording", "failure", OUTLYING, "item")})
    groups = [*about.get("axes", []), "estimator"]
    first = ["recording", *groups]
    last = ["status", "failure", "remarks", OUTLYING, BECAUSE, "item"]
    table = with_outlying(table, groups, judged(about))
    for name in last:
        if name not in table:
            table[name] = ""
    middle = [c for c in table.columns if c not in {*first, *last}]
    return table.reindex(columns=[*first, *middle, *last])


def judged(about: Mapping[str, Any]) -> list[str]:
    """Columns in which a row may be an outlier: unknowns, or else states; sizes of innovations."""
    states = about.get("unknown") or [*about.get("states", {})]
    return [*states, *(f"rms_{name}" for name in about.get("outputs", {})), "nis_ratio"]


def _flat(entry: Entry, about: Mapping[str, Any]) -> dict[str, Any]:
    """A row as columns."""
    row = entry.row
    flat: dict[str, Any] = {"recording": entry.recording["name"]}
    flat |= {key: _cell(value) for key, value in entry.setting.items()}
    flat["estimator"] = entry.estimator
    own = {f"{name}": value for name, value in row.get("x", {}).items()}
    own |= {f"{name}_std": value for name, value in row.get("x_std", {}).items()}
    own |= {f"rms_{name}": value for name, value in row.get("rms", {}).items()}
    own |= {name: row[name] for name in LAST if name in row}
    own["nis_ratio"] = nis_ratio_of(row)
    # Names of the table of recordings give way: what was estimated is called as the model has it.
    taken = {*_names(about), *flat}
    told = entry.recording["changes"] | entry.recording["metadata"]
    flat |= {f"{n} (table)" if n in taken else n: _cell(v) for n, v in told.items()}
    counts = row.get("status", {})
    flat |= own
    flat["status"] = ", ".join(f"{name} {count}" for name, count in counts.items())
    flat |= {"failure": row.get("failure", ""), "remarks": row.get("remarks", "")}
    flat["item"] = entry.item
    return flat


def _names(about: Mapping[str, Any]) -> Iterable[str]:
    """Every name that a column of ours may have."""
    states, outputs = about["states"], about["outputs"]
    of_states = (f"{name}{end}" for name in states for end in ("", "_std"))
    of_rows = (*LAST, "status", "failure", "remarks", OUTLYING, BECAUSE, "item")
    return (*of_states, *(f"rms_{name}" for name in outputs), *of_rows)


def _cell(value: Any) -> Any:
    return value if isinstance(value, int | float | str) or value is None else str(value)


def with_outlying(table: pd.DataFrame, by: Sequence[str], columns: Iterable[str]) -> pd.DataFrame:
    """The table with how far every row is off; infinite for those without an estimate.

    The scale of a column is at least a millionth of its median, so that rounding among recordings
    that agree makes no outliers. NIS and sizes are compared by their logarithms.
    """
    worst = np.zeros(len(table))
    which = np.full(len(table), "", dtype=object)
    groups = table.groupby([*by], sort=False, dropna=False).indices
    for name in columns:
        if name not in table:
            continue
        values = table[name].to_numpy(float)
        if name == "nis_ratio" or name.startswith("rms_"):
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.log(values)
        for rows in groups.values():
            off = _off(values[rows])
            more = off > worst[rows]
            worst[rows[more]], which[rows[more]] = off[more], name
    failed = table["failure"] != ""
    worst[failed], which[failed] = math.inf, "failure"
    return table.assign(**{OUTLYING: worst, BECAUSE: which})


def _off(values: np.ndarray) -> np.ndarray:
    """Robust deviations from the median; zero where there is no number, or fewer than four."""
    finite = np.isfinite(values)
    if finite.sum() < 4:
        return np.zeros(len(values))
    median = np.median(values[finite])
    distance = np.abs(values - median)
    scale = max(NORMAL * np.median(distance[finite]), 1e-6 * abs(median), np.finfo(float).tiny)
    return np.where(finite, distance / scale, 0.0)


def write_table(table: pd.DataFrame, path: Path) -> Path:
    r"""Write a table as Parquet or CSV, by the suffix; whole or not at all.

    Raises
    ------
    OutputError
        If it cannot be written, or Parquet lacks its library.

    Examples
    --------
    >>> import pandas as pd
    >>> from pathlib import Path
    >>> bs.fleet.write_table(pd.DataFrame({"k": [40.0]}), Path("rows.csv")).read_text()
    'k\n40.0\n'
    """
    content = io.BytesIO()
    try:
        if path.suffix == ".parquet":
            table.to_parquet(content, index=False)
        else:
            table.to_csv(content, index=False)
    except ImportError:
        raise OutputError("Parquet files need pyarrow: pip install 'backsight[fleet]'") from None
    return write_whole(path, content.getvalue())
