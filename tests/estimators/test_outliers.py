"""Rules for outliers against gated filters in NumPy, and what they promise of any estimator."""

import dataclasses
import math

import numpy as np
import pytest

import backsight as bs
from backsight.errors import BacksightWarning, TuningError
from backsight.schema import Status
from estimators.contaminated import DT, MOTION, PRIOR, RULES, Q, R, kalman, motion, noise, plant


def in_numpy(rule, u, y, *, open_at: float = 0.5):
    """Kalman filter with weights per channel: estimates, weights, what was taken in openly."""
    A, B = np.array([[1.0, DT], [-150 * DT, 1 - 2 * DT]]), np.array([0.0, DT])
    x, P, share = np.zeros(2), np.diag([0.05, 0.5]) ** 2, np.zeros(2)
    found, weights, opened = [], [], []
    for k in range(len(y)):
        z2 = (y[k] - x) ** 2 / np.diag(P + R)
        match rule:
            case bs.settings.Gate():
                w = 1.0 * (np.sqrt(z2) <= rule.threshold)
            case bs.settings.StudentT():
                w = np.minimum(1, np.sqrt((rule.nu + 1) / (rule.nu + z2)))
            case _:
                w = np.sqrt(np.minimum(1, rule.k / np.sqrt(z2)))
        doubted = w < 0.5
        share = share + (doubted - share) / rule.patience
        opens = share > open_at
        w = np.where(opens, 1, w)
        H, V = np.eye(2)[w > 0], np.diag(np.diag(R)[w > 0] / w[w > 0] ** 2)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + V)
        x, P = x + K @ (y[k] - x)[w > 0], (np.eye(2) - K @ H) @ P
        found.append(x)
        weights.append(w)
        opened.append(opens & doubted)
        x, P = A @ x + B * u[k], A @ P @ A.T + Q
    return np.array(found), np.array(weights), np.array(opened)


ESTIMATORS = {
    "kf": kalman,
    "ekf": lambda n: bs.EKF(n, PRIOR),
    "iekf": lambda n: bs.IEKF(n, PRIOR),
    "ukf": lambda n: bs.UKF(n, PRIOR),
    "mho": lambda n: bs.MHO(n, PRIOR, N=5, alpha=1e-9),
    "mhe": lambda n: bs.MHE(n, PRIOR, N=4),
    "lmhe": lambda n: bs.LinearMHE(n, PRIOR, N=4, arrival_weight=1.0),
}
"""On a linear model all of them are the Kalman filter, or next to it."""


@pytest.mark.parametrize("rule", RULES, ids=lambda r: type(r).__name__)
@pytest.mark.parametrize("build", ESTIMATORS.values(), ids=ESTIMATORS)
def test_every_estimator_weighs_as_a_filter_in_numpy(build, rule):
    y = MOTION.dirty[:60]
    data = MOTION.recording(MOTION.dirty).isel(time=slice(60))
    result = bs.estimate(build(noise(rule)), plant(), data, engine="vm")
    x, weights, opened = in_numpy(rule, MOTION.u, y)
    assert (weights < 0.5).any()
    assert np.allclose(result["weight"], weights, atol=1e-5)
    assert np.allclose(result["x_hat"], x, atol=1e-5)
    assert not opened.any()
    assert not result["status"].any()


@pytest.mark.parametrize("rule", RULES, ids=lambda r: type(r).__name__)
def test_outliers_do_next_to_no_harm(rule):
    errors = {}
    for name, y, n in (
        ("clean", MOTION.clean, noise()),
        ("plain", MOTION.dirty, noise()),
        ("rule", MOTION.dirty, noise(rule)),
    ):
        result = bs.estimate(kalman(n), plant(), MOTION.recording(y), engine="vm")
        errors[name] = np.sqrt(np.mean((result["x_hat"].values - MOTION.x)[20:] ** 2, axis=0))
    assert np.all(errors["rule"] <= 1.1 * errors["clean"])
    assert np.all(errors["plain"] > 3 * errors["clean"])
    doubted = result["weight"].values < 0.5
    assert doubted[MOTION.bad].all()
    assert doubted[~MOTION.bad].mean() <= 0.003


def test_a_sample_that_is_left_out_is_one_that_was_not_measured():
    rule = bs.settings.Gate()
    result = bs.estimate(kalman(noise(rule)), plant(), MOTION.recording(MOTION.dirty), engine="vm")
    gone = result["weight"].values == 0
    without = MOTION.recording(np.where(gone, np.nan, MOTION.dirty))
    expected = bs.estimate(kalman(noise()), plant(), without, engine="vm")
    for name in ("x_hat", "P"):
        assert np.array_equal(result[name], expected[name])
    kept = ~gone
    assert np.array_equal(result["e"].values[kept], expected["e"].values[kept])
    assert bs.check.mean_nis(result) == pytest.approx(bs.check.mean_nis(expected), rel=1e-12)


def test_missing_samples_and_noise_of_single_samples_stay_what_they_are():
    y = MOTION.dirty[:80].copy()
    y[5:30, 0] = np.nan
    factor = np.where(np.arange(80)[:, None] == 40, 1e4, np.ones((80, 2)))
    data = bs.from_arrays(
        u=MOTION.u[:80],
        y=y,
        dt=DT,
        inputs={"F": "N"},
        outputs={"y": "m", "z": "m/s"},
        sigma_factor=factor,
    )
    result = bs.estimate(kalman(noise(RULES[0])), plant(), data, engine="vm")
    weight = result["weight"].values
    assert np.isnan(weight[5:30, 0]).all()
    assert not np.isnan(weight[30:]).any()
    # The innovation of this sample has a large variance itself: there is nothing to doubt.
    assert weight[40].tolist() == [1.0, 1.0]
    assert not result["status"].any()


@pytest.mark.parametrize("lag", [0, 3])
def test_lanes_streams_machine_code_and_virtual_machine_agree(lag):
    estimator = bs.MHE(noise(RULES[1]), PRIOR, N=4, lag=lag)
    data = MOTION.recording(MOTION.dirty).isel(time=slice(60))
    slow = bs.estimate(estimator, plant(), data, engine="vm")
    fast = bs.estimate(estimator, plant(), data, engine="native")
    (lane,) = bs.estimate_many(estimator, plant(), [data])
    for name in ("x_hat", "weight", "status"):
        assert np.allclose(slow[name], fast[name], atol=1e-9)
        assert np.allclose(fast[name], lane[name], atol=1e-9)
    live = bs.stream(estimator, plant(), DT, engine="vm")
    steps = [live.step([u], y) for u, y in zip(MOTION.u[:60], MOTION.dirty[:60], strict=True)]
    weights = np.array([s["weight"] for s in steps])
    assert np.allclose(weights[lag:], slow["weight"][: 60 - lag])


def test_a_window_is_that_of_the_weighed_samples():
    estimator = bs.MHE(noise(RULES[0]), PRIOR, N=6)
    data = MOTION.recording(MOTION.dirty)
    k = int(np.flatnonzero(MOTION.bad.any(axis=1))[3])
    window = bs.solve_window(estimator, plant(), data, at=k)
    result = bs.estimate(estimator, plant(), data.isel(time=slice(k + 1)), engine="vm")
    assert np.allclose(window["x"][-1], result["x_hat"][-1], atol=1e-9)


@pytest.mark.parametrize("rule", RULES, ids=lambda r: type(r).__name__)
def test_no_channel_is_locked_out(rule):
    """A step of 300 standard deviations that stays is taken in, and said."""
    y = MOTION.clean[:200].copy()
    y[60:, 1] += 30.0
    data = bs.from_arrays(
        u=MOTION.u[:200], y=y, dt=DT, inputs={"F": "N"}, outputs={"y": "m", "z": "m/s"}
    )
    result = bs.estimate(kalman(noise(rule)), plant(), data, engine="vm")
    opened = (result["status"].values & int(Status.GATE_OPEN)) != 0
    _, weights, expected = in_numpy(rule, MOTION.u, y)
    assert np.array_equal(opened, expected.any(axis=1))
    assert opened.any()
    first = int(np.flatnonzero(opened)[0])
    assert 60 < first <= 60 + rule.patience
    assert np.allclose(weights, result["weight"])
    y_found, z_found = bs.check.outliers(result)
    assert [y_found.opened, z_found.opened] == expected.sum(axis=0).tolist()
    assert "samples of z looked like outliers but were taken in" in z_found.sentences()[-1]


def test_counts_are_in_verdict_and_summary():
    data, estimator = MOTION.recording(MOTION.dirty), kalman(noise(RULES[0]))
    comparison = bs.compare({"KF": estimator}, plant(), data)
    result = bs.estimate(estimator, plant(), data)
    count = (result["weight"] == 0).sum("time").values
    told = comparison.verdicts()[-1]
    for name, number in zip(("y", "z"), count, strict=True):
        assert f"{number} of 400 samples of {name} were left out as outliers" in told
    assert "consistent, its innovations are as large as it predicts" in told
    assert "over-confident" not in told


def test_a_rule_that_can_never_act_is_told():
    n = bs.Noise(sigma_y={"y": 1e3, "z": 0.1}, Q=Q, outliers=RULES[0])
    with pytest.warns(BacksightWarning, match="of 'y' can never act: all values lie within"):
        comparison = bs.compare({"KF": kalman(n)}, plant(), MOTION.recording(MOTION.clean))
    told = comparison.verdicts()[-1]
    assert "the rule for outliers of y can never act" in told
    assert "of z can never act" not in told


@pytest.mark.parametrize(
    ("estimator", "reason"),
    [
        (bs.Luenberger(noise(RULES[1]), PRIOR, poles=(0.5, 0.6)), "has a constant gain"),
        (bs.KalmanFilter(noise(RULES[2]), PRIOR, steady_state=True), "has a constant gain"),
        (bs.RecursiveMHE(noise(RULES[1]), PRIOR, N=4), "cannot weigh single samples"),
        (bs.RecursiveMHE(noise(RULES[0]), PRIOR, N=4, alpha=0.5), "not right after a sample"),
        (bs.HGO(noise(RULES[2]), PRIOR, gain=20.0), "cannot weigh single samples"),
        (
            bs.CompressiveSensingMHE(noise(RULES[0]), PRIOR, forces=("F",), lam=1.0),
            "would take hits for outliers",
        ),
    ],
    ids=["luenberger", "steady", "rmhe", "rmhe exact", "hgo", "csmhe"],
)
def test_what_cannot_follow_a_rule_says_so(estimator, reason):
    with pytest.raises(TuningError, match=reason):
        estimator.compile(plant(), DT)


GIVEN_GAINS = {
    "steady": lambda n: bs.KalmanFilter(n, PRIOR, steady_state=True),
    "luenberger": lambda n: bs.Luenberger(n, PRIOR, poles=(0.5, 0.6)),
    "rmhe": lambda n: bs.RecursiveMHE(n, PRIOR, N=4),
}


@pytest.mark.parametrize("name", GIVEN_GAINS)
def test_a_gate_goes_with_a_constant_gain(name):
    estimator = GIVEN_GAINS[name](noise(RULES[0]))
    result = bs.estimate(estimator, plant(), MOTION.recording(MOTION.dirty), engine="vm")
    assert (result["weight"].values == 0)[MOTION.bad].all()


OBSERVERS = {
    "hgo": lambda n, prior: bs.HGO(n, prior, gain=20.0),
    "ahg": lambda n, prior: bs.AHG(n, prior, Gamma=np.array([[5.0]]), gain=20.0),
}


@pytest.mark.parametrize("name", OBSERVERS)
def test_a_gate_leaves_out_of_an_observer_what_was_not_measured(name):
    """Outliers of a hundred deviations are gaps to it."""
    rng, n = np.random.default_rng(5), 400
    spring = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - 0.3 * x.v + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"k": 9.0},
    )
    force = np.repeat(4 * rng.standard_normal(n // 10), 10)
    clean = bs.simulate(spring, force, dt=0.01, sigma_y=5e-3, x0=[0.3, 0.0], seed=2)
    bad = (rng.random(n) < 0.02) & (np.arange(n) > 60)  # the start is not known yet
    dirty, gaps = clean.copy(deep=True), clean.copy(deep=True)
    dirty["y"].values[bad, 0] += 0.5 * rng.choice([-1, 1], bad.sum())
    gaps["y"].values[bad] = np.nan
    model = bs.augment(spring, ["k"]) if name == "ahg" else spring
    plain = bs.Noise(sigma_y=5e-3, sigma_w={"v": 1e-2})
    gate = dataclasses.replace(plain, outliers=bs.settings.Gate(probability=1 - 1e-9))
    prior = bs.Prior(sigma_x0=0.5)
    kept, expected = (
        bs.estimate(OBSERVERS[name](n, prior), model, recording, engine="vm")
        for n, recording in ((gate, dirty), (plain, gaps))
    )
    assert np.array_equal(kept["weight"].values[:, 0] == 0, bad)
    np.testing.assert_allclose(kept["x_hat"], expected["x_hat"], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bs.settings.Gate(probability=1.0), "probability is 1.0; it must be from 0.5"),
        (lambda: bs.settings.Gate(patience=1), "patience is 1"),
        (lambda: bs.settings.StudentT(nu=0.0), "nu is 0.0; it must be positive"),
        (lambda: bs.settings.Huber(k=-1.0), "k is -1.0; it must be positive"),
        (lambda: noise("gate"), "outliers"),
    ],
)
def test_wrong_settings_are_told(make, message):
    with pytest.raises(TuningError, match=message):
        make()


def test_thresholds_are_where_a_weight_falls_below_a_half():
    assert bs.settings.Gate(probability=0.9973).threshold == pytest.approx(3.0, abs=1e-3)
    assert bs.settings.StudentT(nu=4.0).threshold == 4.0
    assert bs.settings.Huber(k=1.5).threshold == 6.0


def test_an_estimator_may_not_replace_compile():
    with pytest.raises(bs.errors.BacksightError, match="write 'build'"):
        type("Own", (bs.EKF,), {"compile": lambda *_: None})


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES, ids=lambda r: type(r).__name__)
def test_covariances_are_honest_under_contamination(rule):
    """NEES of 40 recordings: of a gate right, of the others on the safe side."""
    found = []
    for seed in range(40):
        m = motion(seed=seed)
        result = bs.estimate(kalman(noise(rule)), plant(), m.recording(m.dirty))
        error = (result["x_hat"].values - m.x)[20:]
        found.append(np.einsum("ki,kij,kj->k", error, np.linalg.inv(result["P"][20:]), error))
    nees = np.mean(found)
    assert math.isfinite(nees)
    assert 1.7 < nees < 2.1
