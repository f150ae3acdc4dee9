"""The numbers that sum up a result, and the ranking of several."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from backsight.analysis.comparison.error_measures import rms_innovation, rmse
from backsight.analysis.comparison.row import Final, Row
from backsight.analysis.comparison.verdict import sentence
from backsight.analysis.comparison.virtual_outputs import VirtualOutput, virtual_outputs
from backsight.analysis.consistency import (
    Consistency,
    NoiseFactors,
    check_consistency,
    log_likelihood,
    mean_nis,
    measured_channels,
    nis,
    nis_band,
)
from backsight.analysis.forces import FoundHits, fitted_hits, force_remarks, hits
from backsight.analysis.outliers import outliers
from backsight.errors import DataError, nearest
from backsight.schema import COARSE, FAILURES, POSITIVE, Status, check_estimates

ALIGNMENT, ALIGNED = "alignment", "aligned"
"""Attributes of a result: what was found out about its recording, a line per sentence; and 1 if
outputs and inputs belong to the same samples, 0 if not (not there if that is not known)."""

DOUBTS = "doubts"
"""Attribute of a result: which parameters the recording hardly tells, and which readings are not
what they are taken for; a line per sentence."""

MOST_HITS = 50
"""So many of the largest hits are in a summary; all are in the result."""


def assess(
    result: xr.Dataset,
    reference: Mapping[str, float] | None = None,
    *,
    burn_in: float = 0.0,
    name: str | None = None,
) -> Row:
    """Sum up one result.

    Parameters
    ----------
    result : xarray.Dataset
        A result.
    reference : dict, optional
        Known value per state; states of other estimators may be among them.
    burn_in : float
        Time at the start that the averages leave out [s].
    name : str, optional
        Name of the estimator; the result's own if not given.

    Raises
    ------
    DataError
        If the dataset is not a result, or `burn_in` leaves no sample.
    """
    check_estimates(result, "the dataset")
    time = result["time"].values
    settled = result.isel(time=time >= time[:1] + burn_in)
    if settled.sizes["time"] == 0:
        raise DataError(f"a burn-in of {burn_in:g} s leaves none of the {len(time)} samples")
    valid = np.isfinite(nis(settled))
    return Row(
        estimator=name or str(result.attrs.get("estimator", "estimator")),
        samples=len(time),
        log_likelihood=float(log_likelihood(settled).mean("time")),
        mean_nis=mean_nis(settled),
        nis_expected=float(measured_channels(settled).where(valid).mean("time")),
        nis_band=nis_band(settled),
        consistency=check_consistency(settled),
        rms_innovation=_by_name(rms_innovation(settled), "output"),
        rms_error=_rms_error(settled),
        final=_final(result, reference or {}),
        alignment=tuple(str(result.attrs.get(ALIGNMENT, "")).splitlines()),
        aligned=None if ALIGNED not in result.attrs else bool(result.attrs[ALIGNED]),
        us_per_sample=float(result.attrs.get("us_per_sample", math.nan)),
        status=_status_counts(result),
        failed=failed(result),
        remarks=tuple(force_remarks(result)),
        hits=hits(result),
        fitted_hits=fitted_hits(result),
        outliers=outliers(result),
        coarse=str(result.attrs.get(COARSE, "")),
        doubts=tuple(str(result.attrs.get(DOUBTS, "")).splitlines()),
        virtual=virtual_outputs(settled),
    )


def summary(
    result: xr.Dataset, reference: Mapping[str, float] | None = None, *, burn_in: float = 0.0
) -> dict[str, object]:
    """One estimator's entry of ``summary.json``: plain numbers and text, None for "unknown".

    Keys: ``final`` (per state: value, std, unit; with a reference also reference, error,
    relative_error), ``mean_nis``, ``nis_expected``, ``nis_band``, ``mean_log_likelihood``,
    ``rms_innovation``, ``rms_error``, ``us_per_sample``, ``status`` (samples per kind), ``failed``,
    ``verdict`` (a sentence), and what it rests on: ``mean_nees``, ``nees_expected``,
    ``innovations`` (per output: the correlation of successive ones, ``lag1``, the largest one with
    its lag, the share that past inputs explain, and the shares within 1, 2 and 3 deviations),
    ``within`` (per state whose truth is known: the shares within 1, 2 and 3 deviations), and
    ``noise_factors`` (by how much the variances R and Q should be larger) or None; ``hits`` (number
    of unknown forces found, and the largest of them), or None if the estimator looks for none;
    ``fitted_hits`` (hits fitted as pulses: the ``force``, and ``value``, ``std`` and ``unit`` of
    every number);
    ``doubts`` (sentences on parameters that the recording hardly tells, or not from a force, and
    on readings that are not what they are taken for);
    ``outliers`` (per output, if there is a rule for outliers: the ``count`` of samples that were
    left out or weighed down, of ``samples``, and how many were ``opened``, see `Outliers`);
    ``virtual`` (per quantity without a sensor: last ``value`` and ``std``, ``rms``, ``largest``,
    ``typical_std`` and ``unit``, and where its truth is known ``rms_error`` and ``within``).
    Arguments and errors as in `assess`.
    """
    row = assess(result, reference, burn_in=burn_in)
    return {
        "final": {state: _final_entry(final) for state, final in row.final.items()},
        "mean_nis": _known(row.mean_nis),
        "nis_expected": _known(row.nis_expected),
        "nis_band": [_known(limit) for limit in row.nis_band],
        "mean_log_likelihood": _known(row.log_likelihood),
        "rms_innovation": {k: _known(v) for k, v in row.rms_innovation.items()},
        "rms_error": {k: _known(v) for k, v in row.rms_error.items()},
        "us_per_sample": _known(row.us_per_sample),
        "status": row.status,
        "failed": row.failed,
        "verdict": f"{sentence(row)}.",
        "mean_nees": _known(row.consistency.nees.value),
        "nees_expected": _known(row.consistency.nees.expected),
        "innovations": _innovations(row.consistency),
        "within": {state: list(shares) for state, shares in row.consistency.states.items()},
        "noise_factors": _noise_factors(row.consistency.noise),
        "hits": None if row.hits is None else _hits(row.hits),
        "fitted_hits": [hit.entry() for hit in row.fitted_hits],
        "doubts": list(row.doubts),
        "outliers": {
            o.output: {"count": o.count, "samples": o.samples, "opened": o.opened}
            for o in row.outliers
        },
        "virtual": {name: _virtual(found) for name, found in row.virtual.items()},
    }


def ranked_table(
    results: Mapping[str, xr.Dataset],
    reference: Mapping[str, float] | None = None,
    *,
    burn_in: float = 0.0,
) -> list[Row]:
    """One row per estimator, best first.

    By the mean log-likelihood of the innovations: it rewards small innovations and an honest
    covariance, and needs no truth. Estimators without a covariance follow, by the size of their
    innovations; diverged ones come last.

    Raises
    ------
    DataError
        If a dataset is not a result, or `reference` names a state that no result has.
    """
    rows = [assess(r, reference, burn_in=burn_in, name=name) for name, r in results.items()]
    known = {state for row in rows for state in row.final}
    for state in reference or {}:
        if state not in known:
            raise DataError(f"the reference names a state '{state}': {nearest(state, known)}")
    return sorted(rows, key=_rank)


def failed(result: xr.Dataset) -> bool:
    """Return whether the estimates are worthless: a status says so, or the last is not finite."""
    code = result["status"].values.astype(int)
    last = result["x_hat"].isel(time=-1).values
    return bool(np.any(code & FAILURES.value)) or not bool(np.isfinite(last).all())


def units(result: xr.Dataset, dim: str) -> dict[str, str]:
    """Return the unit of every input, output or state (`dim`), by name; "" if there is none."""
    names = [str(n) for n in result[dim].values]
    if f"{dim}_unit" not in result.coords:
        return dict.fromkeys(names, "")
    return dict(zip(names, map(str, result[f"{dim}_unit"].values), strict=True))


def _rank(row: Row) -> tuple[bool, float, float]:
    size = sum(row.rms_innovation.values())
    return row.failed, _worst_if_unknown(-row.log_likelihood), _worst_if_unknown(size)


def _worst_if_unknown(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _final(result: xr.Dataset, reference: Mapping[str, float]) -> dict[str, Final]:
    value, std = (_by_name(result[v].isel(time=-1), "state") for v in ("x_hat", "x_std"))
    sides = [_by_name(result[v].isel(time=-1), "state") for v in ("x_low", "x_high") if v in result]
    skew = set(result.attrs.get(POSITIVE, "").split())
    return {
        state: Final(
            value[state],
            std[state],
            unit,
            reference.get(state),
            (sides[0][state], sides[1][state]) if state in skew and sides else None,
        )
        for state, unit in units(result, "state").items()
    }


def _final_entry(final: Final) -> dict[str, object]:
    entry = {"value": _known(final.value), "std": _known(final.std), "unit": final.unit}
    if final.band is not None:
        entry |= {"low": _known(final.band[0]), "high": _known(final.band[1])}
    if final.reference is None:
        return entry
    return entry | {
        "reference": final.reference,
        "error": _known(final.error),
        "relative_error": _known(final.relative_error),
    }


def _virtual(found: VirtualOutput) -> dict[str, object]:
    entry = dataclasses.asdict(found)
    known = bool(found.within)
    return {
        name: _known(value) if isinstance(value, float) else value
        for name, value in entry.items()
        if known or name not in ("rms_error", "within")
    }


def _innovations(found: Consistency) -> dict[str, object]:
    return {
        c.output: {
            "lag1": _known(c.lag1),
            "largest": _known(c.largest),
            "lag": c.lag,
            "explained_by_inputs": _known(c.explained),
            "within": list(found.innovations.get(c.output, ())),
        }
        for c in found.colours
    }


def _hits(found: FoundHits) -> dict[str, object]:
    largest = [
        {
            "time": hit.impact.time,
            "place": hit.impact.place,
            "position": hit.position,
            "force": hit.force,
            "std": _known(hit.std),
            "impulse": hit.impact.impulse,
            "impulse_std": _known(hit.impact.std or math.nan),
            "start": hit.impact.start,
            "end": hit.impact.end,
        }
        for hit in found.hits[:MOST_HITS]
    ]
    return {"count": len(found.hits), "unit": found.unit, "largest": largest}


def _noise_factors(noise: NoiseFactors | None) -> dict[str, float | None] | None:
    if noise is None:
        return None
    return {name: _known(value) for name, value in dataclasses.asdict(noise).items()}


def _rms_error(result: xr.Dataset) -> dict[str, float]:
    if "x_true" not in result:
        return {}
    errors = rmse(result["x_hat"].values, result["x_true"].values)
    return dict(zip(map(str, result["state"].values), map(float, errors), strict=True))


def _status_counts(result: xr.Dataset) -> dict[str, int]:
    code = result["status"].values.astype(int)
    counts = {"OK": int(np.sum(code == 0))}
    counts |= {str(bit.name): int(np.sum(code & bit.value != 0)) for bit in Status}
    return {kind: count for kind, count in counts.items() if count}


def _by_name(values: xr.DataArray, dim: str) -> dict[str, float]:
    return dict(zip(map(str, values[dim].values), map(float, values.values), strict=True))


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
