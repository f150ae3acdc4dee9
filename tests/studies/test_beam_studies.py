"""The studies of the struck beam: parts by another route, and the whole studies."""

import dataclasses
import json

import numpy as np
import pytest

from backsight.errors import DataError, TuningError
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.run.estimation import estimate, estimate_many
from backsight.types import Array
from backsight_studies import STUDIES
from backsight_studies.beam import evaluate, expected, plant, ridge, tuning, walks
from backsight_studies.beam.claims import judge
from backsight_studies.beam.experiment import carry_out
from backsight_studies.beam.plant import DT, HITS, THICKNESS, N, forces, model, struck
from backsight_studies.beam.tuning import CARRYOVERS, READING_3, TABLE, TUNED, estimator
from backsight_studies.beam.verdicts import checks
from backsight_studies.beam.windows import program
from backsight_studies.beam_experiment.plant import hammer, impulse, reference, true_model
from backsight_studies.beam_random.experiment import outcome
from backsight_studies.beam_random.scenarios import APART, NOISE, SIZES, ByFrequencies, scenario
from oracles import struck_beam

WORST = -10.0
NAMES = ("beam", "beam_random", "beam_experiment")


def test_plant_is_that_of_the_oracle():
    for mismatch, thickness in THICKNESS.items():
        for ours, theirs in zip(
            plant.sampled(thickness), struck_beam.matrices(thickness), strict=True
        ):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12)
        found = plant.frequencies(thickness)
        np.testing.assert_allclose(found, expected.PAPER_FREQUENCIES[mismatch], atol=0.01)
    np.testing.assert_allclose(
        struck(forces())["y"].values, struck_beam.measured(), rtol=1e-9, atol=1e-15
    )


def test_windows_are_those_of_estimates_with_other_lags():
    """The forces read from the memory are those that the estimator puts out."""
    thickness, recording = THICKNESS[WORST], struck(forces()).isel(time=slice(0, 25))
    made = estimator(thickness, TUNED, carryover=CARRYOVERS[READING_3])
    found = program(made, model(thickness), DT).run(recording)
    assert found.alpha.shape == (15, N, 8)
    for lag in (N, 7, 1):
        result = estimate(dataclasses.replace(made, lag=lag), model(thickness), recording)
        ours = result["d_raw"].values[N - lag : N - lag + 15]
        np.testing.assert_allclose(found.alpha[:, N - lag], ours, atol=1e-9)
        if lag == N:
            np.testing.assert_allclose(found.x, result["x_hat"].values[:15], atol=1e-12)
            np.testing.assert_allclose(found.x_std, result["x_std"].values[:15], rtol=1e-9)
    assert np.abs(found.alpha[:, 1:]).max() > 1


def test_one_program_serves_for_all_weights():
    thickness, recording = THICKNESS[WORST], struck(forces())
    made = estimator(thickness, TUNED)
    ready = program(made, model(thickness), DT)
    other = dataclasses.replace(made, lam=TABLE[WORST].lam)
    found = ready.run_with(recording, other.lam)
    (ours,) = estimate_many(other, model(thickness), [recording])
    np.testing.assert_allclose(found.output, ours["d_raw"].values[:-N], atol=1e-9)
    np.testing.assert_allclose(found.lam_max, ours["lam_max"].values[:-N], rtol=1e-6, atol=1e-12)
    assert np.abs(found.output - ready.run(recording).output).max() > 0.1
    score = evaluate.score(found.alpha, forces(), HITS)
    assert (score.false, score.false_large) == (6, 1)
    assert score.mse == pytest.approx(0.0933, rel=0.02)


def test_weights_cannot_be_changed_under_a_carryover():
    made = estimator(THICKNESS[0.0], TUNED, carryover=CARRYOVERS[READING_3])
    with pytest.raises(TuningError, match="no weight but its own"):
        program(made, model(THICKNESS[0.0]), DT).run_with(struck(forces()), 1.0)


def test_score_counts_what_is_there():
    d = forces()
    alpha = evaluate.by_window(d, windows=51, steps=N).copy()
    right = evaluate.score(alpha, d, HITS)
    assert (right.mse, right.relative, right.false, right.false_large) == (0.0, 0.0, 0, 0)
    assert right.recovered == tuple(hit.size for hit in HITS)
    nothing = evaluate.score(np.zeros_like(alpha), d, HITS)
    assert nothing.mse == pytest.approx(expected.ZERO_MSE, rel=1e-3)
    assert nothing.relative == 1.0
    alpha[14, 0, 0], alpha[20, 0, 3], alpha[30, 5, 2] = -2.7, 1.1, 9.0
    wrong = evaluate.score(alpha, d, HITS)
    assert (wrong.false, wrong.false_large) == (2, 1)
    assert wrong.mse == pytest.approx((2.7**2 + 1.1**2 + 81) / alpha.size)


def test_corrections_keep_what_they_say():
    output = np.array([[4.0, -0.5], [0.25, -2.0]])
    amplitude, energy = evaluate.amplitude_rule(output), evaluate.energy_rule(output)
    assert np.abs(amplitude).sum() == pytest.approx(np.abs(output).sum())
    assert (energy**2).sum() == pytest.approx((output**2).sum())
    for corrected in (amplitude, energy):
        np.testing.assert_array_equal(corrected != 0, np.abs(output) >= 1)


def test_ridge_is_the_least_squares_problem_written_out():
    """First window: minimise the cost with alpha'alpha / q over all unknowns."""
    setting, variance, thickness = tuning.Setting(2.0, 1.0, 1e-8), 5.0, THICKNESS[WORST]
    y = struck(forces())["y"].values
    A, B, C = plant.sampled(thickness)
    steps, rows = [np.eye(6, 6 + 160 + 8) @ np.diag([*np.ones(6), *np.zeros(168)])], []
    steps[0] = np.hstack([np.zeros((6, 166)), np.sqrt(setting.eps_Q) * B])
    for k in range(N + 1):
        rows.append(C @ steps[-1])
        ahead = A @ steps[-1]
        if k < N:
            ahead[:, 6 + 8 * k : 14 + 8 * k] += np.sqrt(setting.eps_Q) * B
            ahead[:, 86 + 8 * k : 94 + 8 * k] += np.sqrt(variance) * B
        steps.append(ahead)
    G = np.vstack(rows) / np.sqrt(setting.eps_R)
    unknown = G.shape[1]
    right = np.concatenate([y[5 : 6 + N].ravel() / np.sqrt(setting.eps_R), np.zeros(unknown)])
    z = np.linalg.lstsq(np.vstack([G, np.eye(unknown)]), right, rcond=None)[0]
    wanted = np.sqrt(variance) * z[86:166].reshape(N, 8)
    found = ridge.solutions(thickness, setting, y[5:], variance)[0]
    np.testing.assert_allclose(found, wanted, atol=1e-8)
    assert np.abs(wanted).max() > 0.1


def test_walks_are_the_means_given_what_was_measured():
    """By the covariance of all forces and measurements, without any recursion."""
    thickness, samples, variance, places = THICKNESS[WORST], 22, 3.0, (7, 4, 1)
    recording = struck(forces()).isel(time=slice(0, samples))
    A, B, C = plant.sampled(thickness)
    # Rows of numbers by which independent unit variables make states and forces.
    x, d, y, walk = np.zeros((6, 11 * samples)), np.zeros((3, 11 * samples)), [], []
    for k in range(samples):
        y.append(C @ x)
        walk.append(d.copy())
        x, new = A @ x + B[:, places] @ d, 11 * k
        x[:, new : new + 8] += np.sqrt(walks.BACKGROUND) * B
        d[:, new + 8 : new + 11] += np.sqrt(variance) * np.eye(3)
    measured = recording["y"].values

    def mean(k: int, known: int) -> Array:
        rows = np.vstack(y[:known])
        S = rows @ rows.T + tuning.EPS_R * np.eye(len(rows))
        return walk[k] @ rows.T @ np.linalg.solve(S, measured[:known].ravel())

    filtered, smoothed = walks.walks(thickness, places, recording, variance)
    assert filtered.shape == smoothed.shape == (samples - N, 8)
    for k in range(samples - N):
        np.testing.assert_allclose(filtered[k, places], mean(k + 1, k + 2), atol=1e-7)
        np.testing.assert_allclose(smoothed[k, places], mean(k, samples), atol=1e-7)
    assert np.abs(smoothed).max() > 1


def test_random_walks_and_no_knowledge_agree_at_places_that_can_be_told_apart():
    """Steps of unlimited variance leave nothing of the walk."""
    thickness, recording, d = THICKNESS[0.0], struck(forces()), forces()
    places = walks.PLACES["at three of the hits, without F2"]
    walked, _ = walks.walks(thickness, places, recording, walks.VARIANCES[-1])
    joined = walks.joint(thickness, places, recording)
    np.testing.assert_allclose(joined, walked, atol=0.3)
    assert evaluate.output_mse(walked, d) == pytest.approx(0.099, rel=0.02)
    assert evaluate.output_mse(joined, d) == pytest.approx(0.098, rel=0.02)


def test_scenarios_are_as_described():
    for seed in range(20):
        made, again = scenario(seed), scenario(seed)
        np.testing.assert_array_equal(made.recording["y"], again.recording["y"])
        steps, _ = np.nonzero(made.d)
        assert len(steps) == 4
        assert np.diff(steps).min() >= APART
        sizes = np.abs(made.d[made.d != 0])
        assert SIZES[0] <= sizes.min() <= sizes.max() <= SIZES[1]
    noise = made.recording["y"].values - struck(made.d)["y"].values
    assert np.std(noise) == pytest.approx(NOISE, rel=0.15)
    assert np.abs(scenario(0).d - scenario(1).d).max() > 0


def test_beam_by_its_frequencies_is_the_beam():
    thickness = THICKNESS[WORST]
    by = ByFrequencies(thickness)
    names = plant.FORCES
    ours = state_space(forces_as_inputs(by(by.start()), names))
    theirs = state_space(forces_as_inputs(model(thickness), names))
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_outcome_tells_near_from_exact():
    d = forces()
    found = d.copy()
    found[12, 7], found[13, 6], found[30, 2], found[31, 2] = 0.0, -9.0, 0.9, 1.5
    result = outcome(found, d)
    assert result.false_alarms == 2
    assert result.f1 == pytest.approx(6 / 9)
    assert result.f1_near == pytest.approx(8 / 9)
    assert result.magnitude == pytest.approx(0.0)


def test_hammer_is_the_one_of_the_paper():
    d = reference()
    assert np.argwhere(d > 1e-9).tolist() == [[17, 5], [18, 5]]
    np.testing.assert_allclose(d[17:19, 5], 8.0)
    time = np.linspace(0, 45 * DT, 45_001)
    assert hammer(time).sum() * (time[1] / DT) == pytest.approx(impulse(), rel=1e-6)
    A, B, C, _ = state_space(true_model((8.0, 50.0, 150.0)))
    np.testing.assert_allclose(-np.diag(A[3:, :3]), (2 * np.pi * np.array([8, 50, 150])) ** 2)
    np.testing.assert_allclose(C[1, :3], B[3:, 0])


@pytest.mark.parametrize("name", NAMES)
def test_wrong_calls_are_refused(name, tmp_path):
    study = STUDIES[name]
    with pytest.raises(DataError, match="takes no recordings"):
        study.run(tmp_path / "a", recordings=["x.csv"])
    for seeds in ((), (-1,)):
        with pytest.raises(DataError, match="needs a seed"):
            study.run(tmp_path / "a", seeds=seeds)
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_beam_meets_the_numbers_and_the_checks_can_fail():
    e = carry_out((1,), lambda _what, _share: None)
    found = checks(e, judge(e))
    numbers = [c for c in found if not c.name.startswith("claim")]
    assert [c.name for c in numbers if not c.passed] == []
    assert len(numbers) == 189
    key = ("Table 3", tuning.READING_1, WORST)
    alpha = e.cases[key].windows.alpha.copy()
    alpha[:, 0] *= 1.1
    worse = dataclasses.replace(e.cases[key], score=evaluate.score(alpha, forces(), HITS))
    spoilt = dataclasses.replace(e, cases={**e.cases, key: worse})
    failed = {c.name for c in checks(spoilt, judge(spoilt)) if not c.passed}
    assert any("relative error, deviation: Table 3, reading I, -10" in name for name in failed)
    assert any("hits found, deviation [N]: Table 3, reading I, -10" in name for name in failed)


@pytest.mark.slow
def test_experiment_is_written(tmp_path):
    findings = STUDIES["beam_experiment"].run(tmp_path / "out", seeds=range(3))
    rows = json.loads((tmp_path / "out" / "checks.json").read_text(encoding="utf-8"))
    assert len(rows) == len(findings.checks)
    numbers = [row for row in rows if not row["name"].startswith("claim")]
    assert [row["name"] for row in numbers if not row["passed"]] == []
    printed = next(row for row in rows if "Table 4" in row["name"])
    assert not printed["passed"]
    assert "computed -10.88 %" in printed["measured"]
    for name in ("fig16", "fig18", "fig19", "fig20"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 10_000


@pytest.mark.slow
def test_calibration_makes_all_mismatches_alike(tmp_path):
    findings = STUDIES["beam_random"].run(tmp_path / "out", seeds=range(3))
    best = [c for c in findings.checks if c.name.startswith("l0 with calibration: F1")]
    assert len(best) == 4
    assert all(c.passed for c in best)
    for name in ("methods.png", "frequencies.png", "methods.csv", "study.html"):
        assert (tmp_path / "out" / name).is_file()
