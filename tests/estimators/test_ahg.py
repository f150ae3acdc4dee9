import dataclasses

import numpy as np
import pytest

from backsight.analysis.comparison import convergence_time
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native, vm
from backsight.errors import ModelError, TuningError
from backsight.estimators import AHG, Noise, Prior
from backsight.estimators.observers import AdaptiveGain
from backsight.models.affine import affine_form
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import estimate
from backsight.schema import Status
from backsight_studies.punch.plant import SOFT, STIFF, with_noise
from closeness import assert_close
from estimators.punch import gamma, joint, motion, observer

DT = 1e-4


def textbook(y, F, *, lam, Gamma, theta, interpolation, printed=False):
    """Equation 10 for the punch in NumPy, two Runge-Kutta steps per sample; theta = c/m, d/m, 1/m.

    Returns x (n, 2) and theta (n, 3).
    """
    h = DT / 2

    def model(x, th, u):
        force = u - 30 * np.tanh(50 * x[1])
        return np.array([x[1], -th[0] * x[0] - th[1] * x[1] + th[2] * force])

    def rhs(z, u, y, fixed):
        x, th, U, free = z[:2], z[2:5], z[5:11].reshape(2, 3), z[11:]
        if interpolation == "model":
            y = y + free[0]
        e = y - x[0]
        psi = np.array([-x[0], -x[1], u - 30 * np.tanh(50 * x[1])])
        adapt = Gamma @ U[0]
        surplus = lam if printed else 1.0
        correction = np.array([1.0, lam]) * (lam * np.array([2.0, 1.0]) + surplus * (U @ adapt))
        dU = lam * np.array([U[1] - 2 * U[0], -U[0] + psi])
        return np.concatenate(
            [
                model(x, th, u) + correction * e,
                lam**2 * adapt * e,
                dU.ravel(),
                model(free, fixed, u),
            ]
        )

    def steps(f, z, data):
        for a, b in data:
            middle = (a + b) / 2
            k1 = f(z, a)
            k2 = f(z + h / 2 * k1, middle)
            k3 = f(z + h / 2 * k2, middle)
            k4 = f(z + h * k3, b)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return z

    z = np.concatenate([[0.0, 0.0], theta, np.zeros(6)])
    states = [z]
    for k in range(len(y) - 1):
        fixed, u = z[2:5].copy(), F[k]
        free = steps(lambda x, _, p=fixed, u=u: model(x, p, u), z[:2], [(0.0, 0.0)] * 2)
        ends = {
            "model": (y[k] - z[0], y[k + 1] - free[0]),
            "linear": (y[k], y[k + 1]),
            "hold": (y[k], y[k]),
        }[interpolation]
        middle = sum(ends) / 2
        z = steps(
            lambda v, s, p=fixed, u=u: rhs(v, u, s, p),
            np.concatenate([z[:11], z[:2]]),
            [(ends[0], middle), (middle, ends[1])],
        )[:11]
        states.append(z)
    table = np.array(states)
    return table[:, :2], table[:, 2:5]


@pytest.mark.parametrize(
    ("interpolation", "form"),
    [("model", "consistent"), ("linear", "consistent"), ("hold", "consistent"),
     ("linear", "printed")],
)  # fmt: skip
def test_the_observer_is_equation_10(interpolation, form):
    reading = STIFF if form == "consistent" else SOFT
    lam = {"stiff": 1000.0, "soft": 300.0}[reading.name]
    recording = with_noise(motion(reading), 0).isel(time=slice(0, 600))
    model = joint(reading)
    estimator = observer(1.8, reading=reading, lam=lam, interpolation=interpolation, form=form)
    result = estimate(estimator, model, recording)
    order = [affine_form(model).combinations.index(c) for c in ("c/m", "d/m", "1/m")]
    start = np.array([reading.stiffness / 125, 1500 / 125, 1 / 125 / 1.8])
    x, theta = textbook(
        recording["y"].values[:, 0],
        recording["u"].values[:, 0],
        lam=lam,
        Gamma=gamma(reading, lam)[np.ix_(order, order)],
        theta=start,
        interpolation=interpolation,
        printed=form == "printed",
    )
    found = result["x_hat"].values
    m = 1 / theta[:, 2]
    assert_close(found[:, :2], x, 1e-8)
    assert_close(found[:, 2:], np.column_stack([m, theta[:, 0] * m, theta[:, 1] * m]), 1e-7)


def test_convergence_from_a_wrong_start():
    """Times until within 5 %, from an independent implementation."""
    result = estimate(observer(1.2), joint(), with_noise(motion(), 0))
    time = result["time"].values
    for name, expected in (("m", 0.342), ("c", 0.166), ("d", 0.743)):
        value = result["x_hat"].sel(state=name).values
        found = convergence_time(value, STIFF.truth[name], band=0.05, hold=3000, time=time)
        assert found == pytest.approx(expected, rel=0.02)


def test_holding_the_measurement_biases_the_damping():
    """A delay of half a sample looks like the damping c Ts / 2: 1000 N s/m of 1500."""
    recording = with_noise(motion(), 0)
    late = slice(11_000, None)
    error = {}
    for interpolation in ("hold", "linear", "model"):
        estimator = observer(1.0, rate=30.0, interpolation=interpolation)
        d = estimate(estimator, joint(), recording)["x_hat"].sel(state="d").values[late]
        error[interpolation] = d.mean() / 1500 - 1
    assert error["hold"] == pytest.approx(0.52, rel=0.15)
    assert abs(error["linear"]) < 0.01
    assert abs(error["model"]) < 0.01


def oscillator(bounds=(-np.inf, np.inf)) -> Model:
    k = Signal("1/s2", 120.0, lower=bounds[0], upper=bounds[1])
    plant = Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "m/s2"},
        outputs={"y": "m"},
        parameters={"k": k, "b": Signal("1/s", 2.0)},
    )
    return augment(plant, ["k", "b"])


START = np.diag([0.02, 0.1, 3.0, 0.3]) ** 2
OSCILLATOR = AHG(
    Noise(sigma_y=0.01),
    Prior(P0=START),
    gain=40.0,
    Gamma=np.array([10.0, 0.2]),
    integrator=Integrator("rk4", 4),
)


def run(recursion, u, y, engine=vm):
    data = [u[:, None], np.nan_to_num(y)[:, None], np.isfinite(y).astype(float)[:, None]]
    _, outputs = engine.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def test_covariance_is_the_scatter():
    """Many true starts and noises: the errors at the end are as large as P says."""
    rng, dt, n, runs = np.random.default_rng(5), 0.01, 250, 150
    u = 40 * np.repeat(rng.standard_normal(n // 10), 10)
    q, v, k, b = rng.multivariate_normal([0, 0, 120, 2], START, size=runs).T
    h, positions = dt / 20, []
    for force in u:
        positions.append(q)
        for _ in range(20):
            q_half, v_half = q + h / 2 * v, v + h / 2 * (force - k * q - b * v)
            q, v = q + h * v_half, v + h * (force - k * q_half - b * v_half)
    y = np.array(positions).T + 0.01 * rng.standard_normal((runs, n))
    recursion = OSCILLATOR.compile(oscillator(), dt)
    results = [run(recursion, u, row, native) for row in y]
    final = np.array([r["x_hat"][-1] for r in results])
    errors = final[:, [0, 2, 3]] - np.column_stack([positions[-1], k, b])
    variances = np.array([np.diagonal(r["P"][-1])[[0, 2, 3]] for r in results])
    assert np.all(variances.mean(axis=0)[1:] < 0.5 * np.diag(START)[2:])
    # Variances of 150 samples scatter by 12 %; the bands are three of these.
    np.testing.assert_allclose(np.mean(errors**2, axis=0) / variances.mean(axis=0), 1.0, atol=0.36)


def test_the_prior_covariance_of_the_parameters_comes_back():
    """It goes through 1/m, c/m, d/m and back; the first sample is not used yet."""
    estimator = observer(1.3)
    model = joint()
    result = estimate(estimator, model, motion().isel(time=slice(0, 3)))
    size = np.sqrt(np.diag(estimator.prior.covariance(model)))
    P = result["P"].values[0] / np.outer(size, size)
    np.testing.assert_allclose(P, np.eye(5), atol=1e-12)


def inverted():
    """A recording with the sign of the force wrong: 1/m would have to be negative."""
    recording = with_noise(motion(SOFT), 0).isel(time=slice(0, 5000))
    return recording.assign(u=-recording["u"])


def test_a_divisor_that_passes_through_zero_keeps_the_last_parameters():
    result = estimate(observer(1.0, reading=SOFT, lam=300.0), joint(SOFT), inverted())
    undefined = (result["status"].values & int(Status.UNDEFINED)) != 0
    assert not undefined[0]
    assert undefined[-1]
    x = result["x_hat"].sel(state=["m", "c", "d"]).values
    assert np.isfinite(x).all()
    assert np.isfinite(result["P"].values).all()
    k = np.flatnonzero(undefined[1:] & undefined[:-1])[0] + 1
    np.testing.assert_array_equal(x[k], x[k - 1])
    assert (x[:, 0] > 0).all()


def test_bounds_keep_the_divisor_away_from_zero():
    model = joint(SOFT)
    limits = {"m": (20.0, 400.0), "c": (1e3, 1e6), "d": (0.0, 1e4)}
    states = tuple(
        dataclasses.replace(s, lower=limits[s.name][0], upper=limits[s.name][1])
        if s.name in limits else s
        for s in model.states
    )  # fmt: skip
    bounded = dataclasses.replace(model, states=states)
    result = estimate(observer(1.0, reading=SOFT, lam=300.0), bounded, inverted())
    status = result["status"].values
    assert not (status & int(Status.UNDEFINED)).any()
    assert ((status & int(Status.CLIPPED)) != 0).sum() > 1000
    for name, (low, high) in limits.items():
        x = result["x_hat"].sel(state=name).values
        assert low * (1 - 1e-12) <= x.min()
        assert x.max() <= high * (1 + 1e-12)
    assert result["x_hat"].sel(state="m").values.max() == pytest.approx(400.0)


def test_a_parameter_without_excitation_is_reported():
    """At rest nothing is excited; under a slow force the spring alone is."""
    dt, n = 0.01, 300
    still = run(OSCILLATOR.compile(oscillator(), dt), np.zeros(n), np.zeros(n))
    status = still["status"].astype(int) & int(Status.NOT_EXCITED)
    assert status[-1]
    # The window of 0.5 s in 20 blocks of two samples each is full after 40 samples.
    assert not status[:39].any()
    assert status[39]
    assert still["excitation"].shape == (n, 2)
    np.testing.assert_allclose(still["excitation"][-1], 0.0, atol=1e-6)


def test_a_gap_is_bridged_by_the_model():
    rng, dt, n = np.random.default_rng(1), 0.01, 400
    u = 40 * np.repeat(rng.standard_normal(n // 10), 10)
    y = 0.01 * rng.standard_normal(n)
    y[200:] = np.nan
    result = run(OSCILLATOR.compile(oscillator(), dt), u, y)
    after = result["x_hat"][199:]
    np.testing.assert_allclose(after[:, 2:], np.broadcast_to(after[0, 2:], (201, 2)), rtol=1e-12)
    assert np.all(result["e"][200:] == 0)
    q, v, k, b = after[0]
    for row, force in zip(after[1:11], u[199:209], strict=True):
        for _ in range(400):
            q, v = q + dt / 400 * v, v + dt / 400 * (force - k * q - b * v)
        np.testing.assert_allclose(row[:2], [q, v], rtol=3e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gain": -1.0}, "gain is -1.0"),
        ({"gain": np.nan}, "gain is nan"),
        ({"gain": 1e5, "integrator": Integrator("rk4", 2)}, "lambda = 100000 is too large"),
        ({"poles": (-1.0, 0.1)}, "negative real part"),
        ({"poles": (-1.0, -2.0, -3.0)}, "3 entries; the chain has 2"),
        ({"poles": (-1 + 1j, -2.0)}, "conjugate pairs"),
        ({"Gamma": np.diag([1.0, -1.0, 1.0])}, "positive definite; smallest eigenvalue -1"),
        ({"Gamma": np.array([1.0, 0.0, 1.0])}, "positive definite; smallest eigenvalue 0"),
        ({"Gamma": np.ones((2, 2))}, r"shape \(2, 2\); it must be \(3, 3\) for"),
        ({"Gamma": np.eye(3) + np.eye(3, k=1)}, "symmetric"),
        ({"form": "consistant"}, "unknown form 'consistant'"),
        ({"interpolation": "modell"}, "did you mean 'model'"),
        ({"adaptive": AdaptiveGain(lower=2000.0, gamma=1.0)}, "lower = 2000 must be below"),
    ],
)  # fmt: skip
def test_wrong_settings(settings, message):
    with pytest.raises(TuningError, match=message):
        observer(**settings).compile(joint(), DT)


def test_wrong_models():
    with pytest.raises(TuningError, match=r"do not define .*1/m.*away from zero"):
        observer(0.0).compile(joint(), DT)
    bent = dataclasses.replace(
        joint(), f=lambda x, u, p: [x.v, (u.F - x.c * x.q) / (x.m + x.d), 0, 0, 0]
    )
    with pytest.raises(ModelError, match=r"divisor in .* is a sum with parameters"):
        observer().compile(bent, DT)
