"""The certificate says equal where it must be, and only there; its references by other routes."""

import dataclasses

import numpy as np
import pytest

from analysis.noiseless import Noiseless
from backsight.analysis.certificate.linear_gaussian import (
    LinearGaussian,
    dense_least_squares,
    draw,
    kalman,
    lagged,
    square_root,
)
from backsight.data import from_arrays
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import DataError, TuningError
from backsight.estimators import EKF, MHE, MHO, UKF, KalmanFilter, Limit, LinearMHE, Noise, Prior
from backsight.estimators.arrival import (
    ConstantArrival,
    EKFArrival,
    NoArrival,
    SmoothedArrival,
    UKFArrival,
)
from backsight.estimators.outliers import Gate
from backsight.models.augment import augment
from backsight.models.builtin import duffing
from backsight.models.lti import lti
from backsight.run.diagnosis import certify
from backsight.run.simulation import simulate
from oracles.kalman import kalman_filter
from relations import linear

SYSTEM = LinearGaussian(
    linear.A, linear.B, linear.C, np.zeros((2, 2)), Q=linear.Q, R=linear.R, P0=linear.P0
)
NOISE, PRIOR = linear.GAUSSIANS["noise"], Prior(P0=linear.P0)


@pytest.fixture(scope="module")
def data():
    u = np.random.default_rng(4).standard_normal((30, 2))
    return u, draw(SYSTEM, u, missing=0.3, seed=1)


def test_filter_is_that_of_the_textbook(data):
    _, after = kalman(SYSTEM, *data)
    matrices = {n: getattr(SYSTEM, n) for n in ("A", "B", "C", "Q", "R", "P0")}
    x, P = kalman_filter(data[1], data[0], x0=np.zeros(3), **matrices)
    np.testing.assert_allclose(after.x, x, atol=1e-12)
    np.testing.assert_allclose(after.P, P, atol=1e-12)


@pytest.mark.parametrize("lag", [0, 1, 4])
def test_filter_smoother_and_least_squares_agree(data, lag):
    """Every lagged estimate is that of least squares over the samples up to there."""
    u, y = data
    found = lagged(SYSTEM, u, y, lag)
    for k in (0, 2, 9, 29):
        full = dense_least_squares(SYSTEM, u[: k + 1], y[: k + 1])
        at = max(k - lag, 0)
        np.testing.assert_allclose(found.x[k], full.x[at], atol=1e-11)
        np.testing.assert_allclose(found.P[k], full.P[at], atol=1e-11)


def test_factor_of_a_singular_covariance():
    L = square_root(linear.Q)
    assert L.shape == (3, 2)
    np.testing.assert_allclose(L @ L.T, linear.Q, atol=1e-15)


def test_data_have_the_noise_that_they_should():
    u = np.zeros((4000, 2))
    y = draw(SYSTEM, u, missing=0.25, seed=3)
    assert np.isfinite(y[0]).all()
    assert np.isnan(y).mean() == pytest.approx(0.25, abs=0.02)
    before, _ = kalman(SYSTEM, u, y)
    e = (y - before.x @ linear.C.T)[:, 0]
    S = np.einsum("i,kij,j->k", linear.C[0], before.P, linear.C[0]) + linear.R[0, 0]
    assert np.nanmean(e**2 / S) == pytest.approx(1.0, abs=0.08)


@pytest.fixture(scope="module")
def oscillator():
    """A spring that hardens, its stiffness unknown, and a recording of it."""
    plant = duffing(k1=100.0, d=2.0, k3=50.0)
    u = np.repeat(np.sign(np.random.default_rng(0).standard_normal(60)), 10) * 30
    return augment(plant, ["k1"]), simulate(plant, u, dt=0.02, sigma_y=1e-3)


NOISY = Noise(sigma_y=1e-3, sigma_w={"q": 1e-4, "v": 1e-2, "k1": 0.1})
UNSURE = Prior(sigma_x0={"q": 0.1, "v": 1.0, "k1": 30.0})


@pytest.mark.parametrize(
    "estimator",
    [
        EKF(NOISY, UNSURE),
        EKF(NOISY, UNSURE, integrator=Integrator("heun", 2, "foh")),
        UKF(NOISY, UNSURE),
    ],
)
def test_filters_without_a_window_are_certified(oscillator, estimator):
    certificate = certify(estimator, *oscillator)
    assert certificate.holds
    assert len(certificate.claims) == 1
    assert certificate.references < 1e-11
    assert certificate.lines()[0].startswith(f"{estimator.title} equals the Kalman filter and the")


@pytest.mark.parametrize("lag", [0, 3])
def test_moving_horizon_estimator_is_certified_with_the_right_arrival_costs(oscillator, lag):
    certificate = certify(MHE(NOISY, UNSURE, N=5, lag=lag), *oscillator)
    assert certificate.holds
    found = {c.name: certificate.equal(c) for c in certificate.claims}
    assert found == {
        "SmoothedArrival": True,
        "EKFArrival": True,
        "UKFArrival": True,
        "NoArrival": False,
        "ConstantArrival": False,
        "SmoothedArrival(naive)": False,
    }
    own = certificate.claims[0]
    assert own.own
    assert own.estimates < 1e-10
    text = str(certificate)
    assert "SmoothedArrival (own)" in text
    assert "It would also do so with EKFArrival, UKFArrival." in text
    assert "It would not with NoArrival" in text
    assert ("fixed-lag smoother (lag 3)" in text) == bool(lag)


@pytest.mark.parametrize(
    "arrival", [EKFArrival(), UKFArrival(alpha=0.7), SmoothedArrival(naive=True)]
)
def test_own_arrival_cost_comes_first_whatever_it_is(oscillator, arrival):
    certificate = certify(MHE(NOISY, UNSURE, N=3, arrival=arrival), *oscillator)
    own = certificate.claims[0]
    assert own.own
    assert certificate.holds == (not isinstance(arrival, SmoothedArrival))


def test_limits_and_bounds_are_no_part_of_the_claim(oscillator):
    model, recording = oscillator
    bounded = [dataclasses.replace(s, lower=-0.5, upper=200.0) for s in model.states]
    narrow = dataclasses.replace(model, states=tuple(bounded))
    limit = Limit("push", {"v": 1.0}, upper=1e-6, of="noise")
    assert certify(MHE(NOISY, UNSURE, N=3, limits=(limit,)), narrow, recording).holds


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"outliers": Gate()}, "the rule for outliers"),
        ({"sigma_u": 0.1}, "noise of the inputs (sigma_u)"),
        ({"cross": np.zeros((3, 1))}, "noise that process and sensors have in common (cross)"),
    ],
)
def test_what_is_left_out_is_said(oscillator, settings, said):
    model, recording = oscillator
    noise = dataclasses.replace(NOISY, **settings)
    certificate = certify(EKF(noise, UNSURE), model, recording, at=0.1)
    assert certificate.left_out == (said, "the bounds of k1")
    assert f"Left out of the comparison, and of the claim: {said}, the" in str(certificate)
    assert certificate.holds


def test_limits_are_said_to_be_left_out(oscillator):
    model, recording = oscillator
    bounded = (dataclasses.replace(model.states[0], lower=-0.5), *model.states[1:])
    narrow = dataclasses.replace(model, states=bounded)
    limit = Limit("push", {"v": 1.0}, upper=1e-6, of="noise")
    estimator = MHE(NOISY, UNSURE, N=3, limits=(limit,), soft={"push": 1.0})
    left_out = certify(estimator, narrow, recording, at=0.1).left_out
    assert left_out == ("limits", "soft", "the bounds of q, k1")


def test_a_constant_covariance_is_compared_with_the_others(oscillator):
    arrival = ConstantArrival(np.eye(3))
    certificate = certify(MHE(NOISY, UNSURE, N=3, arrival=arrival), *oscillator, at=0.1)
    assert len(certificate.claims) == 7
    assert not certificate.holds


def test_nothing_is_said_where_nothing_is_left_out(oscillator):
    model, recording = oscillator
    free = [dataclasses.replace(s, lower=-np.inf, upper=np.inf) for s in model.states]
    model = dataclasses.replace(model, states=tuple(free))
    certificate = certify(EKF(NOISY, UNSURE), model, recording, at=0.1)
    assert certificate.left_out == ()
    assert "Left out" not in str(certificate)


def test_what_weighs_data_twice_is_not_certified(oscillator):
    for estimator in (MHO(NOISY, UNSURE, N=5), MHE(NOISY, UNSURE, N=5, arrival=NoArrival())):
        certificate = certify(estimator, *oscillator)
        assert not certificate.holds
        assert "does NOT equal the Kalman filter" in certificate.lines()[0]


def test_linear_estimators_and_their_weights():
    u, y = linear.record(80, seed=2, missing=0.0)
    model = linear.model()
    names = {"inputs": {"f": "", "g": ""}, "outputs": {"y": "", "z": ""}}
    recording = from_arrays(u=u, y=y, dt=linear.DT, **names)
    assert certify(KalmanFilter(NOISE, PRIOR), model, recording).holds
    for weight, holds in ((1.0, True), (0.5, False), (0.0, False)):
        certificate = certify(LinearMHE(NOISE, PRIOR, N=6, arrival_weight=weight), model, recording)
        assert certificate.holds == holds
        others = {c.name: certificate.equal(c) for c in certificate.claims if not c.own}
        assert others == {n: n == "arrival_weight = 1" for n in others}
        assert f"arrival_weight = {weight:g}" not in others


def test_point_may_be_given(oscillator):
    certificate = certify(EKF(NOISY, UNSURE), *oscillator, at={"q": 0.2})
    assert certificate.at == {"q": 0.2, "v": 0.0, "k1": 100.0}
    assert certificate.holds


def test_estimator_without_noise_is_refused(oscillator):
    model, recording = oscillator
    with pytest.raises(TuningError, match="no noise and prior"):
        certify(Noiseless(), model, recording)
    with pytest.raises(DataError, match="no output"):
        certify(EKF(NOISY, UNSURE), model, recording.assign_coords(output=["other"]))


def test_certificate_does_not_pronounce_where_its_references_disagree():
    """A mode that grows by a half per sample: rounding grows with it, in the references, too."""
    names = {"states": {"a": "", "b": ""}, "inputs": {"u": ""}, "outputs": {"y": ""}}
    rng = np.random.default_rng(0)
    y, u = 0.1 * rng.standard_normal(200), rng.standard_normal(200)
    recording = from_arrays(u=u, y=y, dt=1.0, inputs={"u": ""}, outputs={"y": ""})
    growing = lti([[1.5, 0.1], [0.0, 0.9]], [[0.0], [1.0]], [[1.0, 0.0]], dt=1.0, **names)
    estimator = MHE(Noise(sigma_y=0.1, sigma_w=0.1), Prior(sigma_x0=1.0), N=8)
    certificate = certify(estimator, growing, recording)
    found = {c.name: certificate.verdict(c) for c in certificate.claims}
    assert found["SmoothedArrival"] == "cannot tell"
    assert found["NoArrival"] == "differs"
    assert not certificate.holds
    assert "cannot be told" in certificate.lines()[0]


def test_states_so_large_that_their_last_digit_is_a_deviation_tell_nothing():
    """A mode that triples without noise: the references agree by chance, on rounded numbers."""
    names = {"states": {"a": ""}, "inputs": {}, "outputs": {"y": ""}}
    y = np.random.default_rng(1).standard_normal(300)
    recording = from_arrays(y=y, dt=1.0, inputs={}, outputs={"y": ""})
    tripling = lti([[3.0]], np.zeros((1, 0)), [[1.0]], dt=1.0, **names)
    estimator = MHE(Noise(sigma_y=1.0, sigma_w=0.0), Prior(sigma_x0=1.0), N=4)
    certificate = certify(estimator, tripling, recording)
    assert certificate.rounding > 1
    assert not certificate.holds
    assert "cannot be told" in certificate.lines()[0]


def test_nothing_is_told_by_references_that_are_nonsense(oscillator):
    certificate = dataclasses.replace(certify(EKF(NOISY, UNSURE), *oscillator), references=2e86)
    assert certificate.verdict(certificate.claims[0]) == "cannot tell"
    far = dataclasses.replace(certificate.claims[0], x=1e85)
    assert certificate.verdict(far) == "cannot tell"
    assert not certificate.holds
