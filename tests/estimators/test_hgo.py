import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native
from backsight.errors import ModelError, TuningError
from backsight.estimators import HGO, Noise, Prior
from backsight.models.augment import augment
from backsight.models.model import Model

DT, LAM = 0.01, 12.0
K, B = 90.0, 0.6


def model(**changes) -> Model:
    given = {
        "f": lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F],
        "h": lambda x, u, p: [x.q],
        "states": {"q": "m", "v": "m/s"},
        "inputs": {"F": "m/s2"},
        "outputs": {"y": "m"},
        "parameters": {"k": K, "b": B},
    }
    return Model(**(given | changes))


def observer(**settings) -> HGO:
    prior = Prior(sigma_x0={"q": 0.1, "v": 1.0}, x0={"q": 0.05, "v": -0.3})
    given = {"noise": Noise(sigma_y=1e-2), "prior": prior, "gain": LAM}
    return HGO(**(given | settings))


def run(recursion, u, y):
    data = [u[:, None], np.nan_to_num(y)[:, None], np.isfinite(y).astype(float)[:, None]]
    _, outputs = native.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def test_the_observer_is_equation_5():
    """An adaptive solver of the differential equation, measurement joined by lines."""
    rng, n = np.random.default_rng(0), 60
    u, y = rng.standard_normal(n), 0.1 * rng.standard_normal(n)
    settings = {"interpolation": "linear", "integrator": Integrator("rk4", 8)}
    result = run(observer(**settings, poles=(-1 + 0.5j, -1 - 0.5j)).compile(model(), DT), u, y)

    def rhs(t, x):
        k = min(int(t / DT), n - 2)
        e = y[k] + (t / DT - k) * (y[k + 1] - y[k]) - x[0]
        return [x[1] + LAM * 2 * e, -K * x[0] - B * x[1] + u[k] + LAM**2 * 1.25 * e]

    x = np.array([0.05, -0.3])
    for k in range(n - 1):
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=0, atol=1e-7)
        span = (k * DT, (k + 1) * DT * (1 - 1e-13))
        x = solve_ivp(rhs, span, x, rtol=1e-10, atol=1e-12).y[:, -1]
    assert result["lam"][-1] == LAM


def test_the_error_decays_with_the_gain():
    """Without noise and with the true model, the slowest part of the error goes like exp(-lam t).

    The motion itself is part of the observer's model: what decays is the error, whose eigenvalues
    are those of the oscillator with the correction.
    """
    n = 200
    q, v = np.empty(n), np.empty(n)
    for k in range(n):
        t = k * DT
        w, s = np.sqrt(K - B**2 / 4), B / 2
        q[k] = np.exp(-s * t) * np.cos(w * t)
        v[k] = np.exp(-s * t) * (-s * np.cos(w * t) - w * np.sin(w * t))
    error = np.array([[-2 * LAM, 1.0], [-K - LAM**2, -B]])
    slowest = -np.linalg.eigvals(error).real.max()
    result = run(observer().compile(model(), DT), np.zeros(n), q)
    size = np.hypot(result["x_hat"][:, 0] - q, (result["x_hat"][:, 1] - v) / LAM)
    rate = np.log(size[20] / size[100]) / (80 * DT)
    assert rate == pytest.approx(slowest, rel=0.2)
    assert size[-1] < 1e-7


def test_constants_keep_their_values_and_their_doubt_is_in_the_bands():
    """Oscillators whose stiffness is not the one of the observer: P must cover their errors."""
    rng, n, runs = np.random.default_rng(2), 300, 100
    u = 3 * np.repeat(rng.standard_normal(n // 10), 10)
    joint = augment(model(), ["k"])
    prior = Prior(x0={"k": K}, sigma_x0={"q": 1e-6, "v": 1e-6, "k": 9.0})
    recursion = observer(prior=prior, noise=Noise(sigma_y=1e-3)).compile(joint, DT)
    k = rng.normal(K, 9.0, size=runs)
    q, v, h, positions = np.zeros(runs), np.zeros(runs), DT / 20, []
    speeds = []
    for force in u:
        positions.append(q)
        speeds.append(v)
        for _ in range(20):
            q_half, v_half = q + h / 2 * v, v + h / 2 * (force - k * q - B * v)
            q, v = q + h * v_half, v + h * (force - k * q_half - B * v_half)
    y = np.array(positions).T + 1e-3 * rng.standard_normal((runs, n))
    results = [run(recursion, u, row) for row in y]
    np.testing.assert_array_equal(results[0]["x_hat"][:, 2], K)
    P = np.mean([r["P"] for r in results], axis=0)
    np.testing.assert_allclose(P[:, 2, 2], 81.0, rtol=1e-12)
    for i, truth in enumerate((np.array(positions).T, np.array(speeds).T)):
        errors = np.array([r["x_hat"][:, i] for r in results]) - truth
        ratio = np.mean(errors[:, 50:] ** 2) / np.mean(P[50:, i, i])
        assert ratio == pytest.approx(1.0, abs=0.35)
    doubtless = observer(noise=Noise(sigma_y=1e-3)).compile(model(), DT)
    assert P[-1, 1, 1] > 2 * run(doubtless, u, y[0])["P"][-1, 1, 1]


def test_bands_cover_a_random_walk():
    """The process noise does not change the estimate but the covariance."""
    n = 100
    data = np.zeros(n), 0.01 * np.random.default_rng(1).standard_normal(n)
    walking = Noise(sigma_y=1e-2, sigma_w={"v": 0.05})
    still, moved = (
        run(observer(noise=noise).compile(model(), DT), *data)
        for noise in (Noise(sigma_y=1e-2), walking)
    )
    np.testing.assert_array_equal(still["x_hat"], moved["x_hat"])
    assert moved["P"][-1, 1, 1] > 1.5 * still["P"][-1, 1, 1]


def test_after_a_gap_the_measurement_counts_for_one_period():
    """With every third sample measured, the estimate still follows."""
    n = 600
    t = np.arange(n) * DT
    q = np.exp(-B / 2 * t) * np.cos(np.sqrt(K - B**2 / 4) * t)
    y = np.where(np.arange(n) % 3 == 0, q, np.nan)
    result = run(observer().compile(model(), DT), np.zeros(n), y)
    assert np.abs(result["x_hat"][-1, 0] - q[-1]) < 1e-4
    np.testing.assert_array_equal(result["e"][1::3], 0.0)


def test_bands_with_gaps():
    """Scatter over many noises, with two of five samples measured; the start is known exactly."""
    rng, n, runs = np.random.default_rng(7), 100, 300
    prior = Prior(x0=[0.0, 0.0], sigma_x0=1e-9)
    recursion = observer(prior=prior).compile(model(), DT)
    errors = []
    for _ in range(runs):
        y = 1e-2 * rng.standard_normal(n)
        y[np.arange(n) % 5 > 1] = np.nan
        result = run(recursion, np.zeros(n), y)
        errors.append(result["x_hat"])
    variances = np.var(errors, axis=0)[50:]
    P = np.diagonal(result["P"], axis1=1, axis2=2)[50:]
    np.testing.assert_allclose(np.mean(variances / P, axis=0), 1.0, atol=0.1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gain": 0.0}, "gain is 0.0"),
        (
            {"gain": 600.0, "integrator": Integrator("rk4", 2)},
            r"lambda \* h = 3 is outside its stable range",
        ),
        (
            {"gain": 250.0, "integrator": Integrator("euler", 1)},
            "more substeps or a smaller lambda",
        ),
        ({"poles": 0.0}, "negative real part"),
        ({"poles": (-1.0, -1.0, -1.0)}, "the chain has 2 states"),
        ({"interpolation": "zoh"}, "unknown interpolation 'zoh'"),
    ],
)
def test_wrong_settings(settings, message):
    with pytest.raises(TuningError, match=message):
        observer(**settings).compile(model(), DT)


@pytest.mark.parametrize(("scheme", "limit"), [("euler", 2.0), ("heun", 2.0), ("rk4", 2.785)])
def test_stable_range_of_the_methods(scheme, limit):
    """The double pole at -lam: the limits of the textbooks."""
    for factor in (0.999, 1.001):
        estimator = observer(gain=factor * limit / DT, integrator=Integrator(scheme, 1))
        if factor < 1:
            estimator.compile(model(), DT)
        else:
            with pytest.raises(TuningError, match="stable range"):
                estimator.compile(model(), DT)


def test_wrong_models():
    two = model(h=lambda x, u, p: [x.q, x.v], outputs={"y": "", "z": ""})
    noise = Noise(sigma_y=[1e-2, 1e-2])
    with pytest.raises(ModelError, match="one output"):
        observer(noise=noise).compile(two, DT)
    loop = model(f=lambda x, u, p: [x.v + u.F * x.v**2, -p.k * x.q])
    with pytest.raises(ModelError, match="equation of 'q'"):
        observer().compile(loop, DT)
