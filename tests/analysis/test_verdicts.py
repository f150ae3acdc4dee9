"""Causes are told apart: what the verdict says of filters that believe in the wrong thing."""

import re

import numpy as np
import pytest

from analysis import believing
from backsight.analysis.comparison._summary import assess
from backsight.analysis.comparison.verdict import agreement
from backsight.analysis.consistency import (
    FilterPath,
    NoiseFactors,
    check_consistency,
    noise_factors,
)
from backsight.errors import DataError
from backsight.run.diagnosis._factors_of_results import factors_of


def said(result):
    return agreement(assess(result))


def test_consistent_filter_is_called_consistent(believing_results):
    found = [said(r) for r in believing_results(60, n=1200)]
    assert sum(f.startswith("consistent, ") for f in found) >= 57


def test_gaps_do_not_make_a_filter_inconsistent(believing_results):
    found = [said(r) for r in believing_results(10, n=1500, missing=0.3)]
    assert sum(f.startswith("consistent, ") for f in found) >= 9


CAUSES = {
    "R too small": ({"R_true": 4.0}, r"R is about (3\.[5-9]|4\.[0-5]) times too small$"),
    "with gaps": (
        {"R_true": 4.0, "missing": 0.3},
        r"R is about (3\.[2-9]|4\.[0-8]) times too small$",
    ),
    "R too large": ({"R_true": 0.25}, r"R is about (3\.[3-9]|4\.[0-9]) times too large$"),
    "Q too small": (
        {"Q_true": 10.0},
        r"positively correlated.*process noise Q is about (7|8|9|1\d)(\.\d)? times too small$",
    ),
    "Q too large": ({"Q_true": 0.1}, r"[^R]+ process noise Q is about \d+(\.\d)? times too large$"),
    "both": ({"Q_true": 4.0, "R_true": 4.0}, r"Q and R are both about (3|4)\.\d times too small$"),
    "opposite": (
        {"Q_true": 0.1, "R_true": 4.0},
        r"R is about (3|4)\.\d times too small and the process noise Q (about|far).*too large$",
    ),
    "gain": (
        {"gain": 2.0},
        r"past inputs explain .* of 'y'.* the model answers its input wrongly, .*\(sigma_u\)",
    ),
    "force": ({"force": 15.0}, r"correlated.*the model lacks dynamics or a force"),
}


@pytest.mark.parametrize("name", CAUSES)
def test_cause_is_named_with_its_size(name, believing_results):
    wrong, says = CAUSES[name]
    sentences = [said(r) for r in believing_results(5, **wrong)]
    assert sum(bool(re.search(says, s)) for s in sentences) >= 4, sentences
    assert not any(s.startswith("consistent, ") for s in sentences)


def test_signs_decide_where_the_filter_is_not_known(believing_results):
    """R and Q are named by the pattern alone, and only where it tells them apart."""
    for wrong, says in (
        ({"Q_true": 10.0}, "; the process noise Q is too small"),
        ({"R_true": 0.25}, "; R is too large"),
        ({"Q_true": 4.0, "R_true": 4.0}, "Q and R are both too small, or one of them by far"),
    ):
        for result in believing_results(5, **wrong):
            bare = result.drop_attrs().assign_attrs(estimator="kf")
            assert said(bare).endswith(says)


def test_factors_and_their_deviations_agree(believing_results):
    """Over the seeds, the factors scatter by their standard deviations around the truth."""
    found = [check_consistency(r).noise for r in believing_results(60, n=1200)]
    scores = np.array([[(f.R - 1) / f.R_std, (f.Q - 1) / f.Q_std] for f in found])
    assert np.abs(scores.mean(axis=0)).max() < 0.5
    assert 0.5 < scores.std() < 1.6


def test_what_cannot_be_told_is_not_told(believing_results):
    result = believing_results(5, R_true=4.0)[0]
    vague = result.assign_attrs(noise_factors=[2.0, 1.5, 3.0, 2.5, 0.01, 0.7, 0.8])
    assert said(vague).endswith("whether Q or R is the cause cannot be told from them")
    half = result.assign_attrs(noise_factors=[4.0, 0.1, 3.0, 2.5, 0.01, 30.0, 0.8])
    assert said(half).endswith(
        "R is about 4.0 times too small; whether Q fits cannot be told from them"
    )


def test_known_alignment_sharpens_the_verdict(believing_results):
    result = believing_results(5, gain=2.0)[0]
    assert "wrongly, or y and u are misaligned" in said(result)
    assert "misaligned" not in said(result.assign_attrs(aligned=1))
    assert "wrongly" not in said(result.assign_attrs(aligned=0))


def test_noise_that_has_no_part_in_the_innovations_is_not_judged(believing_results):
    result = believing_results(5, R_true=4.0)[0]
    n = result.sizes["time"]
    found = noise_factors(
        FilterPath(
            F=np.broadcast_to(believing.A, (n, 2, 2)),
            H=np.broadcast_to([[1.0, 0.0]], (n, 1, 2)),
            P=result.P.values,
            e=result.e.values,
            S=result.S.values,
            Q=np.zeros((n, 2, 2)),
            R=believing.R,
        )
    )
    assert np.isnan(found.Q)
    assert abs(found.R - 4.0) < 0.6


def test_no_factors_for_what_is_no_kalman_filter(believing_results):
    result = believing_results(5, R_true=4.0)[0]
    other = result.assign(y_hat=result.y_hat + 0.5 * (result.y - result.y_hat))
    assert factors_of(other, believing.FILTER, believing.MODEL) is None
    short = result.isel(time=slice(0, 600))
    assert factors_of(short, believing.FILTER, believing.MODEL) is None


def test_consistency_prints_what_it_knows(believing_results):
    found = check_consistency(believing_results(8)[0])
    assert found.consistent
    assert isinstance(found.noise, NoiseFactors)
    text = str(found)
    for part in (
        "mean NIS",
        "mean NEES",
        "past inputs explain",
        "within 1 / 2 / 3 σ",
        "R should be",
    ):
        assert part in text


def test_consistency_refuses_what_is_no_result(believing_results):
    result = believing_results(8)[0]
    with pytest.raises(DataError, match="not a result"):
        check_consistency(result.drop_vars("S"))
    with pytest.raises(DataError, match="no sample"):
        check_consistency(result.isel(time=slice(0)))
