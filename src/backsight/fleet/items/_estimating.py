"""Run the estimators over recordings of one model and period, and keep what is asked for."""

import functools
import secrets
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

from backsight.engine.dense import UNROLL
from backsight.estimators.base import AbstractEstimator
from backsight.fleet.items._reading import Reading, reason_of, said_with
from backsight.fleet.items.work import Work
from backsight.fleet.rows.numbers import Told, failed_row, row_of_result, row_of_totals
from backsight.models.model import Model
from backsight.output import make_folder, put_in_place, writing
from backsight.problem.results_file import write_estimates
from backsight.run.estimation import Outputs, estimate_many, smooth
from backsight.run.summaries import estimate_summaries

NEEDED = ("x_std", "e", "S", "y")
"""What a row is made of if it is made of a result."""


def estimate_group(members: Sequence[Reading], work: Work) -> float:
    """Run all estimators over recordings of one model and period; returns the seconds."""
    problem = members[0].problem
    assert problem is not None
    spent = 0.0
    for name, estimator in problem.estimators.items():
        began = time.perf_counter()
        smoothed = name in problem.smoothed
        rows, failure = _rows(members, estimator, problem.model, smoothed=smoothed)
        if failure and len(members) > 1:  # one of them is at fault; the others shall not suffer
            for one in members:
                rows, failure = _rows([one], estimator, problem.model, smoothed=smoothed)
                one.rows[name] = failed_row(failure) if failure else rows[0]
        else:
            for one, row in zip(members, rows or [failed_row(failure)], strict=True):
                one.rows[name] = row
        spent += time.perf_counter() - began
    if work.keep is not None:
        began = time.perf_counter()
        for one in members:
            one.failure = one.failure or reason_of(functools.partial(_write, one, work))
        spent += time.perf_counter() - began
    return spent


def _rows(
    members: Sequence[Reading], estimator: AbstractEstimator, model: Model, *, smoothed: bool
) -> tuple[list[Told], str]:
    """Rows of an estimator over recordings, or why there are none."""
    rows: list[Told] = []
    white = estimator.innovations == "white"
    data = [one.data for one in members if one.data is not None]

    def run() -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if smoothed:
                results = [smooth(estimator, model, d, throw=False) for d in data]
            elif model.ny > UNROLL:
                kept = Outputs(NEEDED)
                results = estimate_many(
                    estimator, model, data, outputs=kept, threads=1, throw=False
                )
            else:
                totals = estimate_summaries(estimator, model, data, threads=1)
                rows.extend(row_of_totals(totals, k, white=white) for k in range(len(data)))
                return
            rows.extend(
                row_of_result(r, dt=float(d.attrs["dt"]), white=white)
                for r, d in zip(results, data, strict=True)
            )

    return rows, reason_of(run)


def _write(one: Reading, work: Work) -> None:
    """Write what is kept of the results of a recording, whole or not at all."""
    problem, data, keep = one.problem, one.data, work.keep
    assert problem is not None
    assert data is not None
    results = {}
    for name, estimator in problem.estimators.items():
        if name in problem.smoothed:
            results[name] = smooth(estimator, problem.model, data, throw=False)
        else:
            results[name], *_ = estimate_many(
                estimator, problem.model, [data], outputs=keep, threads=1, throw=False
            )
    folder = Path(work.results)
    target = folder / f"{one.piece.item}.nc"
    part = folder / f".{target.name}.{secrets.token_hex(4)}.part"
    with writing(folder):
        make_folder(folder)
        try:
            write_estimates(
                part,
                results,
                title=f"{problem.title}: {one.piece.listed.name}",
                problem=said_with((*work.setting, *one.piece.listed.changes), problem.text),
                covariance=True,
            )
            put_in_place(part, target)
        finally:
            part.unlink(missing_ok=True)
