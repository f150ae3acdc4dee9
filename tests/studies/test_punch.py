import dataclasses
import json
import math

import numpy as np
import pytest
import xarray as xr

from backsight.errors import DataError
from backsight.output import MARKER
from backsight.schema import Status
from backsight_studies import STUDIES
from backsight_studies.checks import Check
from backsight_studies.punch.claims import percent, seconds, slowest
from backsight_studies.punch.evaluate import judge_gain, measure, parameters_of, respond
from backsight_studies.punch.experiment import median
from backsight_studies.punch.plant import (
    DT,
    SOFT,
    STIFF,
    excitation,
    simulate_punch,
    with_noise,
)
from backsight_studies.punch.scenarios import ONLY_D, STARTS


def result_of(n, *, m=1.0, c=1.0, d=1.0, lam=None, inverse=False, status=0):
    """A result and its recording: estimates per truth, constant or (n,)."""
    factors = {"m": m, "c": c, "d": d}
    truth = STIFF.truth
    x = {p: np.broadcast_to(factors[p], n) * truth[p] for p in truth}
    if inverse:
        x["inverse"] = 1 / x.pop("m")
    coords = {"time": np.arange(n) * DT, "state": list(x)}
    result = xr.Dataset(
        {
            "x_hat": (("time", "state"), np.column_stack(list(x.values()))),
            "status": ("time", np.broadcast_to(status, n).astype(np.int32)),
        },
        coords=coords,
        attrs={"us_per_sample": 1.0},
    )
    if lam is not None:
        result["lam"] = ("time", lam)
    recording = xr.Dataset(
        {"x_true": (("time", "state"), np.tile(list(truth.values()), (n, 1)))},
        coords={"time": coords["time"], "state": list(truth)},
    )
    return result, recording


@pytest.mark.parametrize("inverse", [False, True])
def test_the_truth_has_no_error(inverse):
    m = measure(*result_of(100_001, inverse=inverse))
    for values in (m.time, m.error, m.bias, m.std):
        np.testing.assert_allclose(list(values.values()), 0.0, atol=1e-15)


def test_times_and_errors_are_where_they_are():
    n = 100_001
    late = np.where(np.arange(n) < 12_345, 1.2, 1.0)
    noise = 1 + 0.02 * np.where(np.arange(n) % 2, 1, -1)
    m = measure(*result_of(n, m=late, c=1.06, d=noise))
    assert m.time["m"] == pytest.approx(1.2345)
    assert math.isnan(m.time["c"])
    assert m.bias["c"] == pytest.approx(0.06)
    assert m.error["c"] == pytest.approx(0.06)
    assert m.time["d"] == 0.0
    assert m.std["d"] == pytest.approx(0.02)
    assert m.bias["d"] == pytest.approx(0.0, abs=1e-12)


def test_an_undefined_parameter_has_not_converged():
    result, recording = result_of(100_001, status=int(Status.UNDEFINED))
    assert np.isnan(parameters_of(result)["m"]).all()
    m = measure(result, recording)
    assert all(math.isnan(v) for v in m.time.values())


def test_response_to_a_jump():
    n = 80_000
    c = np.ones(n)
    c[40_000:41_500] = 0.8
    d = np.ones(n)
    d[40_100] = 3.0
    d[75_000:] = 1.01
    response = respond(*result_of(n, c=c, d=d), at=4.0, until=8.0)
    assert response.time["c"] == pytest.approx(0.15)
    assert response.excursion["c"] == pytest.approx(0.2)
    assert response.excursion["d"] == pytest.approx(2.0)
    assert response.excursion["m"] == 0.0
    assert response.error["d"] == pytest.approx(0.01)


def test_gain_before_and_after_a_jump():
    n = 60_001
    c = np.ones(n)
    c[:40_000] += 0.003 * np.where(np.arange(40_000) % 2, 1, -1)
    c[40_000:42_000] = 0.9
    lam = np.full(n, 100.0)
    lam[40_300:] = 950.0
    gain = judge_gain(*result_of(n, c=c, lam=lam), at=4.0, upper=1000.0)
    assert gain.std["c"] == pytest.approx(0.003)
    assert gain.time == pytest.approx(0.2)
    assert gain.before == 100.0
    assert gain.rise == pytest.approx(0.03)


def test_never_counts_as_last():
    assert median([0.1, math.nan, 0.3]) == 0.3
    assert math.isnan(median([0.1, math.nan, math.nan]))
    assert slowest({"m": 0.1, "c": math.nan}) == math.inf
    assert seconds(math.inf) == seconds(math.nan) == "never"
    assert seconds(0.3273) == "0.327 s"
    assert percent(1e-8) == "0 %"
    assert percent(-0.0065) == "−0.65 %"


def test_starts():
    assert [s.label for s in STARTS] == ["soft, 1.8 p", "soft, 1.2 p", "stiff, 1.8 p",
                                         "stiff, 1.2 p"]  # fmt: skip
    assert STARTS[2].start == {"m": 1.8 * 125, "c": 1.8 * 20e6, "d": 1.8 * 1500}
    assert ONLY_D[0].start == {"m": 125, "c": 20e3, "d": 1.8 * 1500}


def test_what_the_motion_excites():
    """The soft spring hardly matters, the stiff one nearly cancels the force."""
    soft, stiff = (excitation(simulate_punch(r, seconds=0.12), r) for r in (SOFT, STIFF))
    assert soft["spring"] < 0.02 * soft["actuator"]
    assert stiff["damper"] < 0.01 * stiff["spring"]
    assert stiff["spring"] == pytest.approx(stiff["actuator"], rel=0.1)


def test_noise_is_added_to_the_measurement_only():
    clean = simulate_punch(SOFT, seconds=0.01)
    noisy = with_noise(clean, 3)
    expected = 1e-6 * np.random.default_rng(3).standard_normal((101, 1))
    np.testing.assert_allclose(noisy["y"] - clean["y"], expected, atol=1e-17)
    np.testing.assert_array_equal(noisy["x_true"], clean["x_true"])


def test_what_cannot_be_studied_is_refused(tmp_path):
    with pytest.raises(DataError, match="takes no recordings"):
        STUDIES["punch"].run(tmp_path / "out", recordings=["a.csv"])
    for seeds in ((), (0, -1)):
        with pytest.raises(DataError, match="seeds"):
            STUDIES["punch"].run(tmp_path / "out", seeds=seeds)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_study(tmp_path):
    told = []
    findings = STUDIES["punch"].run(
        tmp_path / "out", seeds=[0, 1], progress=lambda *what: told.append(what)
    )
    written = {p.name for p in (tmp_path / "out").iterdir()}
    assert written == {
        MARKER,
        "study.html", "checks.json", "starts.csv", "jumps.csv", "gains.csv", "biases.csv",
        "claims.csv", "figure2.png", "figure3.png", "figure4.png", "figure5.png", "bias.png",
    }  # fmt: skip
    checks = json.loads((tmp_path / "out" / "checks.json").read_text())
    assert [list(c) for c in checks] == [[f.name for f in dataclasses.fields(Check)]] * len(checks)
    missed = [c["name"] for c in checks if not (c["passed"] or c["name"].startswith("claim"))]
    assert not missed
    assert findings.page.read_text().count("data:image/png;base64,") == 5
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-2] < 1.0 == shares[-1]
    claims = {c["name"].removeprefix("claim: "): c["passed"] for c in checks}
    assert claims["The AHG converges faster than EKF and UKF: all three parameters "
                  "[stiff, 1.8 p, filters as in the paper, qx = 3]"]  # fmt: skip
    assert not claims["The AHG converges faster than EKF and UKF: all three parameters "
                      "[stiff, 1.8 p, tuned filters, qx = 0.01]"]  # fmt: skip
