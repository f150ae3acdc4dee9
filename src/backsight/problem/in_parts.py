"""Run a problem whose recording need not fit into memory."""

import json
import math
import os
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import xarray as xr

from backsight.estimators import ALL_ESTIMATORS
from backsight.output import write_whole, writing
from backsight.problem.problem import Problem
from backsight.problem.reading.checking import at
from backsight.problem.recorded import parts_of
from backsight.rounding import significant
from backsight.run.estimation import Outputs
from backsight.run.parts import estimate_parts, smooth_parts
from backsight.schema import FAILURES, STATUS_TEXT

PARTS, SUMMARY_OF_PARTS = "parts", "summary.json"
"""Folder with a store for each estimator, and the file with what sums them up."""

FAIR = 1.25
"""Ratio of the mean NIS to its expectation beyond which covariances are called wrong. Over millions
of samples any ratio differs from 1 beyond chance; what counts is by how much."""


def run_in_parts(
    problem: Problem,
    out: str | os.PathLike[str],
    *,
    progress: Callable[[str, float], None] = lambda *_: None,
    env: Collection[str] = (),
) -> dict[str, xr.Dataset]:
    """Run all estimators of a problem over its recording, part by part.

    Results are in ``parts/ESTIMATOR``, which `backsight.large.read_store` reads, and what sums
    them up in ``summary.json``. A run that was interrupted goes on after the last whole part, with
    the same results to the last bit. What is smoothed goes through the recording twice, see
    `backsight.large.smooth_parts`.

    Parameters
    ----------
    problem : Problem
        With a table ``recording.parts``.
    out : path
        Folder; missing ones are made.
    progress : callable
        Told the estimator at work and the share of its parts that is done.
    env : collection of str
        Environment variables that paths may use beside ``BACKSIGHT_DATA``.

    Returns
    -------
    dict
        Name of the estimator to what `backsight.large.estimate_parts` or, of those that are
        smoothed, `backsight.large.smooth_parts` returns.

    Raises
    ------
    ProblemError, DataError, OutputError
        As of `run_problem` and `backsight.large.estimate_parts`.
    """
    table = problem.recording.parts
    assert table is not None
    with at("recording.parts"):
        kept = None if table.variables is None else tuple(table.variables)
        outputs = Outputs(kept, every=table.every, dtype=table.dtype)
    parts, folder = parts_of(problem, env=env), Path(out)
    found: dict[str, xr.Dataset] = {}
    for name, estimator in problem.estimators.items():
        with at(f"estimators.{name}"), ALL_ESTIMATORS.blamed(estimator.key):
            run = smooth_parts if name in problem.smoothed else estimate_parts
            found[name] = run(
                estimator,
                problem.model,
                parts,
                folder / PARTS / re.sub(r"[^A-Za-z0-9+-]", "_", name),
                outputs=outputs,
                progress=lambda done, count, name=name: progress(name, done / count),
            )
    told = {name: _told(row) for name, row in found.items()}
    text = json.dumps({"title": problem.title, "estimators": told}, indent=2, ensure_ascii=False)
    with writing(folder):
        write_whole(folder / SUMMARY_OF_PARTS, f"{text}\n".encode())
    return found


def _told(rows: xr.Dataset) -> dict[str, object]:
    """A row as plain numbers and text, None for "unknown"."""
    if _smoothed(rows):
        residuals = zip(rows["output"].values, rows["rms_residual"].values, strict=True)
        return {
            "samples": int(rows["samples"]),
            "smoothed": True,
            "rms_residual": {str(n): _known(rms) for n, rms in residuals},
            "status": [text for bit, text in STATUS_TEXT.items() if bit & int(rows["status"])],
            "failure": failure_in_parts(rows) or None,
        }
    row = rows.isel(recording=0)
    states = zip(row["state"].values, row["x_hat"].values, row["x_std"].values, strict=True)
    outputs = zip(row["output"].values, row["rms_innovation"].values, strict=True)
    return {
        "samples": int(row["samples"]),
        "final": {str(n): {"value": _known(x), "std": _known(std)} for n, x, std in states},
        "mean_nis": _known(row["mean_nis"]),
        "nis_expected": _known(row["nis_expected"]),
        "mean_log_likelihood": _known(row["mean_log_likelihood"]),
        "rms_innovation": {str(n): _known(rms) for n, rms in outputs},
        "status": {
            str(flag): int(count)
            for flag, count in zip(row["flag"].values, row["status_count"].values, strict=True)
            if count
        },
        "failure": failure_in_parts(rows) or None,
    }


def _smoothed(rows: xr.Dataset) -> bool:
    return "rms_residual" in rows


def _known(value: object) -> float | None:
    number = float(value)  # pyright: ignore[reportArgumentType]
    return number if math.isfinite(number) else None


def failure_in_parts(rows: xr.Dataset) -> str:
    """Say at which sample an estimator failed, and why; empty if it did not."""
    if _smoothed(rows):
        cause = _cause(int(rows["status"]))
        return f"failed: {cause}" if cause else ""
    at_sample, status = int(rows["failed_at"][0]), int(rows["status"][0])
    if at_sample < 0:
        return ""
    return f"failed at sample {at_sample}: {_cause(status)}"


def _cause(status: int) -> str:
    """What made an estimator fail; empty if nothing did."""
    return next((text for bit, text in STATUS_TEXT.items() if bit & FAILURES & status), "")


def lines_of_parts(found: Mapping[str, xr.Dataset]) -> list[str]:
    """What came out, a line for each estimator."""
    return [f"{name}: {_line(rows)}" for name, rows in found.items()]


def _line(rows: xr.Dataset) -> str:
    if reason := failure_in_parts(rows):
        return reason
    if _smoothed(rows):
        residuals = zip(rows["output"].values, rows["rms_residual"].values, strict=True)
        told = ", ".join(f"{n} {significant(float(rms), 3)}" for n, rms in residuals)
        return f"smoothed, {int(rows['samples'])} samples; root mean square of residuals: {told}"
    row = rows.isel(recording=0)
    units = [str(u) for u in row["state_unit"].values]
    states = zip(row["state"].values, row["x_hat"].values, row["x_std"].values, units, strict=True)
    last = ", ".join(
        f"{n} = {significant(float(x), 6)} ± {significant(float(std), 2)} {unit}".rstrip()
        for n, x, std, unit in states
    )
    return f"{last} after {int(row['samples'])} samples; {_judged(row)}"


def _judged(row: xr.Dataset) -> str:
    ratio = float(row["mean_nis"]) / float(row["nis_expected"])
    if not math.isfinite(ratio):
        return "its covariances cannot be judged"
    said = f"the mean NIS is {significant(ratio, 3)} of its expectation"
    if ratio > FAIR:
        return f"over-confident, {said}"
    return f"too cautious, {said}" if ratio < 1 / FAIR else f"consistent, {said}"
