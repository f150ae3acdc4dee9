import json
import math
import re

import numpy as np
import pytest

from backsight.analysis.comparison import Final
from backsight.analysis.comparison._summary import assess, ranked_table, summary, units
from backsight.analysis.comparison.verdict import agreement, verdicts
from backsight.analysis.consistency import log_likelihood, mean_nis
from backsight.errors import DataError
from backsight.schema import Status


def with_status(result, *, at, status):
    code = result.status.values.copy()
    code[at] |= status
    return result.assign(status=(("time",), code))


def without_covariance(result):
    return result.assign(S=result.S * np.nan, P=result.P * np.nan, x_std=result.x_std * np.nan)


def test_summary_has_the_agreed_form(result):
    entry = summary(result, {"q": 0.01})
    final = entry["final"]["q"]
    assert final["value"] == float(result.x_hat[-1, 0])
    assert final["std"] == float(result.x_std[-1, 0])
    assert final["unit"] == "m"
    assert final["error"] == pytest.approx(final["value"] - 0.01)
    assert final["relative_error"] == pytest.approx(final["value"] / 0.01 - 1.0)
    assert set(entry["final"]["v"]) == {"value", "std", "unit"}
    assert entry["mean_nis"] == pytest.approx(mean_nis(result))
    assert entry["us_per_sample"] == 1.5
    assert entry["status"] == {"OK": 300}
    assert entry["failed"] is False


def test_summary_is_strict_json_even_if_nothing_is_known(result):
    blind = without_covariance(result.assign(x_hat=result.x_hat * np.nan))
    del blind.attrs["us_per_sample"]
    entry = summary(blind, {"q": 0.0})
    text = json.dumps(entry, allow_nan=False)
    assert json.loads(text)["final"]["q"]["value"] is None
    assert json.loads(text)["us_per_sample"] is None
    assert json.loads(text)["failed"] is True


def test_status_counts_every_bit(result):
    both = with_status(result, at=[3, 4], status=Status.CLIPPED)
    both = with_status(both, at=[4], status=Status.ITERATION_LIMIT)
    assert summary(both)["status"] == {"OK": 298, "CLIPPED": 2, "ITERATION_LIMIT": 1}


def test_burn_in_leaves_out_the_start_of_the_averages_only(result):
    late = assess(result, burn_in=1.0)
    rest = result.isel(time=slice(100, None))
    assert late.mean_nis == pytest.approx(mean_nis(rest))
    assert late.log_likelihood == pytest.approx(float(log_likelihood(rest).mean()))
    assert late.samples == 300


def test_burn_in_of_everything_is_refused(result):
    with pytest.raises(DataError, match="burn-in of 99 s"):
        assess(result, burn_in=99.0)


def test_expected_nis_is_the_mean_number_of_measured_channels(gappy):
    seen = np.isfinite(gappy.y.values).sum(axis=1)
    assert assess(gappy).nis_expected == pytest.approx(seen[seen > 0].mean())


def test_rms_error_needs_the_truth(result):
    error = (result.x_hat - result.x_true).values
    expected = np.sqrt(np.mean(error**2, axis=0))
    assert assess(result).rms_error == pytest.approx({"q": expected[0], "v": expected[1]})
    assert assess(result.drop_vars("x_true")).rms_error == {}


def test_ranking_is_by_likelihood_then_innovations_then_failure(result, filtered):
    worse = filtered(noise_factor=4.0)
    bare = without_covariance(result)
    failed = with_status(result, at=[9], status=Status.NOT_FINITE)
    rough = bare.assign(e=2.0 * bare.e)
    given = {"failed": failed, "rough": rough, "bare": bare, "worse": worse, "best": result}
    rows = ranked_table(given)
    assert [r.estimator for r in rows] == ["best", "worse", "bare", "rough", "failed"]
    assert [r.failed for r in rows] == [False, False, False, False, True]


def test_estimates_that_are_not_finite_are_a_failure_whatever_the_status_says(result):
    x = result.x_hat.values.copy()
    x[-1, 1] = np.nan
    assert assess(result.assign(x_hat=(result.x_hat.dims, x))).failed


def test_reference_of_an_unknown_state_gets_a_hint(result):
    with pytest.raises(DataError, match=r"'qq'.*did you mean 'q'"):
        ranked_table({"KF": result}, {"qq": 1.0})


def test_a_dataset_that_is_no_result_is_refused(result):
    with pytest.raises(DataError, match="'S'"):
        ranked_table({"KF": result.drop_vars("S")})


def test_units_of_a_foreign_dataset_are_empty(result):
    assert units(result, "state") == {"q": "m", "v": "m/s"}
    assert units(result.drop_vars("state_unit"), "state") == {"q": "", "v": ""}


def test_final_errors():
    final = Final(value=9.0, std=0.5, unit="kg", reference=-10.0)
    assert (final.error, final.relative_error, final.deviations) == (19.0, 1.9, 38.0)
    unknown = Final(value=9.0, std=0.0, unit="kg")
    assert all(math.isnan(v) for v in (unknown.error, unknown.relative_error, unknown.deviations))
    assert math.isnan(Final(value=9.0, std=0.5, unit="", reference=0.0).relative_error)


def test_verdicts_name_the_best_and_the_dishonest(result, filtered):
    lines = verdicts(ranked_table({"bold": filtered(noise_factor=0.25), "KF": result}))
    assert lines[0].startswith("KF explains the recording best, by ")
    assert lines[1].startswith("KF: consistent")
    assert "bold: over-confident" in lines[2]


def test_verdict_says_by_how_much_the_innovations_are_misjudged(filtered):
    bold = agreement(assess(filtered(3000, noise_factor=0.25)))
    shy = agreement(assess(filtered(3000, noise_factor=4.0)))
    assert "2.0 times as large as it predicts" in bold
    assert re.search(r"(49|50|51) % smaller than it predicts", shy)


def test_verdict_on_references(result):
    near, far = float(result.x_hat[-1, 0]), float(result.x_hat[-1, 1]) + 1.0
    (line,) = verdicts(ranked_table({"KF": result}, {"q": near}))
    assert line.endswith("within 3σ of every reference.")
    (line,) = verdicts(ranked_table({"KF": result}, {"q": near, "v": far}))
    assert line.endswith("further than 3σ from the reference of v.")


def test_verdict_without_covariance_and_of_failures(result):
    (line,) = verdicts(ranked_table({"AHG": without_covariance(result)}))
    assert "nothing can be said" in line
    failed = with_status(result, at=[9], status=Status.NOT_FINITE)
    assert verdicts(ranked_table({"a": failed, "b": failed}))[0] == "All estimators diverged."


def test_a_result_without_covariances_of_the_states_is_judged_by_its_innovations(result):
    """As files keep it; its truth tells the errors, but not the NEES."""
    truth = result.assign(x_true=result.x_hat + 0.1 * result.x_std).drop_vars("P")
    assert verdicts(ranked_table({"KF": truth})) == verdicts(ranked_table({"KF": result}))
