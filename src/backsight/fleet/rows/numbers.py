"""What the row of a recording says: the same numbers by totals, or from the result itself."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from backsight.analysis.comparison.error_measures import rms_innovation
from backsight.analysis.consistency import log_likelihood, measured_channels, nis
from backsight.schema import FAILURES, STATUS_TEXT, Status

Told = dict[str, Any]
"""Plain numbers and texts, as JSON knows them."""


def failed_row(reason: str) -> Told:
    """Row of a recording without an estimate."""
    return {"failure": reason}


def row_of_totals(rows: xr.Dataset, k: int, *, white: bool) -> Told:
    """Row of recording k of what `estimate_summaries` returns.

    Parameters
    ----------
    rows : xarray.Dataset
    k : int
    white : bool
        Whether the innovations of the estimator are white by nature.
    """
    one = rows.isel(recording=k)
    counts = dict(zip(map(str, one["flag"].values), one["status_count"].values, strict=True))
    return _row(
        one,
        samples=int(one["samples"]),
        nis=(float(one["mean_nis"]), float(one["nis_expected"])),
        likelihood=float(one["mean_log_likelihood"]),
        rms=one["rms_innovation"],
        counts={name: int(count) for name, count in counts.items() if count},
        failed_at=int(one["failed_at"]),
        status=int(one["status"]),
        dt=float(rows.attrs["dt"]),
        white=white,
    )


def row_of_result(result: xr.Dataset, *, dt: float, white: bool) -> Told:
    """Row of a result that has the innovations ``e``, their covariance and the outputs ``y``."""
    code = result["status"].values.astype(int)
    failed = np.flatnonzero(code & FAILURES.value)
    squares = nis(result)
    channels = measured_channels(result).where(np.isfinite(squares)).mean("time")
    last = result.isel(time=-1)
    return _row(
        last,
        samples=result.sizes["time"],
        nis=(float(squares.mean("time")), float(channels)),
        likelihood=float(log_likelihood(result).mean("time")),
        rms=rms_innovation(result),
        counts={
            str(bit.name).lower(): int(count)
            for bit in Status
            if bit and (count := np.count_nonzero(code & bit.value))
        },
        failed_at=int(failed[0]) if len(failed) else -1,
        status=int(np.bitwise_or.reduce(code)),
        dt=dt,
        white=white,
    )


def _row(
    last: xr.Dataset,
    *,
    samples: int,
    nis: tuple[float, float],
    likelihood: float,
    rms: xr.DataArray,
    counts: Mapping[str, int],
    failed_at: int,
    status: int,
    dt: float,
    white: bool,
) -> Told:
    names = [str(name) for name in last["state"].values]
    return {
        "samples": samples,
        "dt": dt,
        "x": dict(zip(names, map(float, last["x_hat"].values), strict=True)),
        "x_std": dict(zip(names, map(float, last["x_std"].values), strict=True)),
        "mean_nis": nis[0],
        "nis_expected": nis[1],
        "white": white,
        "log_likelihood": likelihood,
        "rms": dict(zip(map(str, rms["output"].values), map(float, rms.values), strict=True)),
        "status": dict(counts),
        "failed_at": failed_at,
        "failure": _failure(failed_at, status, dt),
    }


def _failure(failed_at: int, status: int, dt: float) -> str:
    if failed_at < 0:
        return ""
    cause = next((text for bit, text in STATUS_TEXT.items() if bit & FAILURES & status), "")
    return f"failed at sample {failed_at} ({failed_at * dt:g} s after the first): {cause}"


def row_text(row: Told) -> str:
    """JSON by which every number comes back to the last bit."""
    return json.dumps(row, separators=(",", ":"), ensure_ascii=False)


def row_of_text(text: str) -> Told:
    """What `row_text` has written."""
    return json.loads(text)


def nis_ratio_of(row: Told) -> float:
    """Mean NIS by its expectation."""
    nis, expected = row.get("mean_nis", math.nan), row.get("nis_expected", math.nan)
    return nis / expected if expected and expected > 0 else math.nan
