import dataclasses
import json
import math

import numpy as np
import pytest
import xarray as xr

from backsight.errors import DataError, OutputError
from backsight.output import MARKER
from backsight_studies import STUDIES
from backsight_studies.checks import Check
from backsight_studies.nanopositioner.claims import CLAIMS
from backsight_studies.nanopositioner.evaluate import (
    Measures,
    measure,
    posterior_start,
    run_variant,
    speed_floor,
)
from backsight_studies.nanopositioner.expected import REFERENCE
from backsight_studies.nanopositioner.experiment import SCENARIOS, compared
from backsight_studies.nanopositioner.plant import (
    COLUMNS,
    DT,
    as_table,
    read_recording,
    simulate_stage,
)
from backsight_studies.nanopositioner.tuning import ekf, joint_model

# Rows of recordings made by an independent implementation with the same seed, by exact steps of
# the matrix exponential: u, y, q, v, w behind the filter; k/m, b/m, c/m.
WITH = (7063833.78353007, 77.60739164015938, 540000.0)
WITHOUT = (9209880.56450294, 86.79466519631737, 704056.1339972838)
ROWS = {
    "nominal": {
        0: (1.975847051994033, -5.71623786658001, -5.716480452031088, -6912.7261611359, 0, *WITH),
        1999: (2.7732943282612865, 3.4404159963740155, 3.4397335953420476, 3519.275440815093, 0,
               *WITH),
        2015: (0.972954743508925, -2.51337057881631, -2.514260111160035, 7604.214643393198,
               203592.90323885353, *WITHOUT),
        4001: (1.3500422134055194, 0.20209998708003976, 0.2028583291095933, -10649.151303667943,
               1.0800249583553523e-12, *WITHOUT),
    },
    "mode2": {
        0: (1.975847051994033, -5.710737282542551, -5.710979867993839, -6854.470876708812, 0,
            *WITH),
        1999: (2.7732943282612865, 3.4544545781142495, 3.453772177082262, 3450.207102813724, 0,
               *WITH),
        2015: (0.972954743508925, -2.5053337072203443, -2.5062232395641177, 7585.119506418743,
               203592.90323885353, *WITHOUT),
        4001: (1.3500422134055194, 0.2105850205636101, 0.21134336259312014, -10645.1394962817,
               1.0800249583553523e-12, *WITHOUT),
    },
}  # fmt: skip
SIZE = np.array([7.0, 20.0, 20.0, 5e4, 4e5, 1e7, 90.0, 7e5])


@pytest.fixture(scope="module")
def stages():
    return {scenario: simulate_stage(0, mode2=gain) for scenario, gain in SCENARIOS.items()}


def short_stage(stage):
    """The 1500 samples around the removal."""
    return stage.isel(time=slice(1700, 3200)).assign_coords(time=np.arange(1500) * DT)


def write(stage, path):
    np.savetxt(path, as_table(stage), fmt="%.17g", delimiter=",", header=",".join(COLUMNS))
    return path


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_plant_equals_an_independent_implementation(stages, scenario):
    table = as_table(stages[scenario])
    for k, row in ROWS[scenario].items():
        np.testing.assert_allclose(table[k] / SIZE, row / SIZE, rtol=0, atol=1e-11)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_benchmark_filter_meets_the_independent_implementation(stages, scenario):
    m = measure(run_variant(ekf(), stages[scenario]), stages[scenario])
    x1, x2, tolerance = REFERENCE[scenario, "EKF"]
    np.testing.assert_allclose([m.rse_x1, m.rse_x2], [x1, x2], rtol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("variant", compared()[1:], ids=lambda v: v.label)
def test_the_observers_meet_the_independent_implementation(stages, scenario, variant):
    m = measure(run_variant(variant, stages[scenario]), stages[scenario])
    x1, x2, tolerance = REFERENCE[scenario, variant.label]
    np.testing.assert_allclose([m.rse_x1, m.rse_x2], [x1, x2], rtol=tolerance)


def result_of(stage, **factors):
    """A result with the truth as estimate, times a factor."""
    names = [s.name for s in joint_model().states]
    truth = stage["x_true"].sel(state=names)
    factor = xr.DataArray([factors.get(n, 1.0) for n in names], dims="state")
    n = stage.sizes["time"]
    return xr.Dataset(
        {
            "x_hat": truth * factor,
            "y": posterior_start(stage)["y"],
            "e": (("time", "output"), np.full((n, 1), 2e-3)),
            "S": (("time", "output", "output_"), np.full((n, 1, 1), 1e-6)),
        },
        attrs={"us_per_sample": 1.0},
    )


def test_the_truth_has_no_error_but_that_of_the_measurement(stages):
    stage = stages["nominal"]
    m = measure(result_of(stage), stage)
    noise = stage["y"].values[:, 0] - stage["x_true"].sel(state="q").values
    assert m.rse_x1 == pytest.approx(np.linalg.norm(noise[1:4001]))
    assert m.rse_x2_settled == pytest.approx(speed_floor(stage))
    assert m.rms_q == m.rms_v == m.rms_v_transient == m.k_time == m.std_k == m.step_b == 0.0
    assert m.nis == pytest.approx(4.0)
    assert math.isnan(m.evaluations)


def test_errors_are_measured_where_they_are(stages):
    stage = stages["nominal"]
    m = measure(result_of(stage, v=1.01, k=1.03), stage)
    speed = stage["x_true"].sel(state="v").values
    assert m.rms_v == pytest.approx(0.01 * np.sqrt(np.mean(speed[201:4001] ** 2)))
    assert m.rms_v_transient == pytest.approx(0.01 * np.sqrt(np.mean(speed[2000:2200] ** 2)))
    assert math.isnan(m.k_time)
    assert m.std_k == pytest.approx(0.0, abs=1e-12)


def test_convergence_counts_from_the_removal(stages):
    stage = stages["nominal"]
    result = result_of(stage)
    late = (stage["time"] >= 0.2) & (stage["time"] < 0.2124)
    result["x_hat"] = result["x_hat"].where(~late | (result["state"] != "k"), 7e6)
    assert measure(result, stage).k_time == pytest.approx(12.4)


def measures(**changes):
    return Measures(
        **(dict.fromkeys([f.name for f in dataclasses.fields(Measures)], 1.0) | changes)
    )


def test_claims_are_decided_by_the_numbers():
    claims = {c.short: c.holds for c in CLAIMS}
    ordered = {"EKF": measures(rse_x1=3.0), "MHOa": measures(), "MHOb": measures(rse_x1=2.0)}
    swapped = ordered | {"MHOa": ordered["MHOb"], "MHOb": ordered["MHOa"]}
    assert claims["order of RSE x1"](ordered)
    assert not claims["order of RSE x1"](swapped)
    never = measures(k_time=math.nan)
    assert claims["faster with MHOa"]({"EKF": never, "MHOa": measures(), "MHOb": never})
    assert not claims["faster with MHOa"]({"EKF": measures(), "MHOa": never, "MHOb": never})
    assert not claims["faster with MHOa"]({"EKF": never, "MHOa": never, "MHOb": never})
    quiet = {"EKF": never, "MHOa": measures(std_b=2.0), "MHOb": measures()}
    assert not claims["scatter of the parameters"](quiet)


def test_a_diverged_estimator_supports_no_claim():
    bad = measures(**{f.name: math.nan for f in dataclasses.fields(Measures)})
    assert not any(c.holds({"EKF": bad, "MHOa": bad, "MHOb": bad}) for c in CLAIMS)


def test_files_are_read_back(stages, tmp_path):
    read = read_recording(write(stages["mode2"], tmp_path / "stage.csv"))
    np.testing.assert_array_equal(as_table(read), as_table(stages["mode2"]))


def test_a_study_of_a_recording(stages, tmp_path):
    file = write(short_stage(stages["nominal"]), tmp_path / "short & <sweet>.csv")
    told = []
    findings = STUDIES["nanopositioner"].run(
        tmp_path / "out", seeds=(), recordings=[file], progress=lambda *what: told.append(what)
    )
    written = {p.name for p in (tmp_path / "out").iterdir()}
    assert written == {
        MARKER, "study.html", "checks.json", "measures.csv", "table1.csv", "claims.csv",
        "figure4.png",
        "figure5.png", "figure6.png", "figure7.png", "transient.png",
    }  # fmt: skip
    checks = json.loads((tmp_path / "out" / "checks.json").read_text())
    assert [list(c) for c in checks] == [[f.name for f in dataclasses.fields(Check)]] * len(checks)
    assert len(checks) == 2 * len(CLAIMS) + 1
    page = findings.page.read_text()
    assert "short &amp; &lt;sweet&gt;" in page
    assert "<sweet>" not in page
    assert page.count("data:image/png;base64,") == 5
    rows = np.genfromtxt(
        tmp_path / "out" / "measures.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    assert list(rows["method"]) == ["EKF", "MHOa", "MHOb", "MHOa", "MHOb"]
    assert np.isfinite(rows["rse_x1"]).all()
    assert [share for _, share in told] == sorted(share for _, share in told)
    assert told[-1][1] == 1.0
    assert "9 statements" in str(findings)


def test_a_diverged_estimator_does_not_end_the_study(stages, tmp_path, monkeypatch):
    def diverged(variant, stage):
        result = run_variant(ekf(), stage)
        gone = result["x_hat"].where((result["time"] < 0.001) | (variant.method == "EKF"))
        return result.assign(x_hat=gone)

    monkeypatch.setattr("backsight_studies.nanopositioner.experiment.run_variant", diverged)
    file = write(short_stage(stages["nominal"]), tmp_path / "short.csv")
    findings = STUDIES["nanopositioner"].run(tmp_path / "out", seeds=(), recordings=[file])
    assert not any(c.passed for c in findings.checks)
    assert json.loads((tmp_path / "out" / "checks.json").read_text())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        ("# a,b\n1,2\n", "must begin with '# u_filt_V"),
        ("# " + ",".join(COLUMNS) + "\n1,2\n", "must begin with"),
        ("# " + ",".join(COLUMNS) + "\n1,2,3,4,5,6,7,x\n", "cannot be read"),
        ("# " + ",".join(COLUMNS) + "\n1,2,3,4,5,6,7,nan\n", "not finite"),
        ("# " + ",".join(COLUMNS) + "\n" + "1,2,3,4,5,6,7,8\n" * 9, "9 samples; the study needs"),
    ],
)
def test_wrong_recordings_are_refused_and_leave_nothing_behind(tmp_path, content, message):
    file = tmp_path / "recording.csv"
    if content is not None:
        file.write_text(content)
    with pytest.raises(DataError, match=message):
        STUDIES["nanopositioner"].run(tmp_path / "out", seeds=(), recordings=[file])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("seeds", [(), (0, -1)])
def test_wrong_seeds_are_refused(tmp_path, seeds):
    with pytest.raises(DataError, match="seeds"):
        STUDIES["nanopositioner"].run(tmp_path / "out", seeds=seeds)
    assert not (tmp_path / "out").exists()


def test_a_place_that_cannot_be_written_is_found_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        STUDIES["nanopositioner"].run(
            tmp_path / "file" / "out", progress=lambda what, share: pytest.fail("it began")
        )
