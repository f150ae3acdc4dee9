"""Sparse forces on nonlinear models, against least squares on the simulated motion itself."""

import dataclasses
import functools

import casadi as ca
import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import BacksightWarning, TuningError
from backsight.run import sparse_forces

DT, SAMPLES, CUBIC = 0.02, 40, 3e6
FORCES = ("F1", "F2", "F3", "F4")
SHAPES = np.array([[0.2, -0.5], [0.5, -0.6], [0.8, 0.1], [1.0, 1.0]])
STIFFNESS, DAMPING = np.array([200.0, 1500.0]), np.array([1.0, 4.0])
HITS = {(6, 1): -9.0, (20, 2): 7.0}
SENSORS = np.array([[0.5, -0.6], [1.0, 1.0]])


def structure(cubic=CUBIC, *, joint=False):
    """Two modes with a spring at the tip that hardens; how much may be a state, in parts of it."""

    def f(x, u, p):
        tip = x.a + x.b
        pull = cubic * tip**3 * (x.k if joint else 1.0)
        given = [sum(SHAPES[j, i] * p[n] for j, n in enumerate(FORCES)) for i in range(2)]
        q, v = (x.a, x.b), (x.va, x.vb)
        rates = [given[i] + u.f - STIFFNESS[i] * q[i] - DAMPING[i] * v[i] - pull for i in range(2)]
        return [x.va, x.vb, *rates, *([0.0] if joint else [])]

    return bs.Model(
        f=f, h=lambda x, u, p: ca.vertsplit(ca.DM(SENSORS) @ ca.vertcat(x.a, x.b)),
        states=dict.fromkeys(("a", "b", "va", "vb", *(["k"] if joint else [])), ""),
        inputs={"f": "N"}, outputs={"y": "m", "z": "m"},
        parameters=dict.fromkeys(FORCES, (0.0, "N")), name="hardening",
    )  # fmt: skip


def moved(x0, u, d, stiff=1.0):
    """States at the samples, by many small steps."""

    def rate(x, force):
        pull = stiff * CUBIC * (x[0] + x[1]) ** 3
        return np.concatenate([x[2:], force - STIFFNESS * x[:2] - DAMPING * x[2:] - pull])

    x, rows = np.array(x0, float), []
    for k in range(len(d)):
        rows.append(x)
        force, h = d[k] @ SHAPES + u[k], DT / 10
        for _ in range(10):
            a = rate(x, force)
            b = rate(x + h / 2 * a, force)
            c = rate(x + h / 2 * b, force)
            e = rate(x + h * c, force)
            x = x + h / 6 * (a + 2 * b + 2 * c + e)
    return np.array(rows)


@functools.cache
def recording():
    rng, d = np.random.default_rng(1), np.zeros((SAMPLES, 4))
    for place, size in HITS.items():
        d[place] = size
    u = 0.3 * np.sin(0.2 * np.arange(SAMPLES))[:, None]
    y = moved(np.zeros(4), u, d)[:, :2] @ SENSORS.T + 1e-4 * rng.standard_normal((SAMPLES, 2))
    y[rng.random(y.shape) < 0.05] = np.nan
    return bs.from_arrays(
        u=u, y=y, dt=DT, inputs={"f": "N"}, outputs={"y": "m", "z": "m"}
    ), d  # fmt: skip


METHOD = bs.CompressiveSensingMHE(
    noise=bs.Noise(sigma_y=1e-4), prior=bs.Prior(sigma_x0=2e-4), forces=FORCES, lam=3.0,
)  # fmt: skip
KNOWING = dataclasses.replace(
    METHOD,
    prior=bs.Prior(
        sigma_x0={"a": 2e-4, "b": 2e-4, "va": 2e-4, "vb": 2e-4, "k": 0.5}, x0={"k": 0.6}
    ),
)
find = bs.forces.find_sparse_forces


def score(result):
    return bs.forces.compare_forces(result["d_hat"].values, recording()[1], least=1.0).f1


def test_hits_are_found_where_a_linear_model_finds_others():
    linear = find(METHOD, structure(0.0), recording()[0])
    found = find(METHOD, structure(), recording()[0])
    assert score(linear) < 0.6
    assert score(found) == 1
    assert found.attrs["nonzeros"] == len(HITS)
    assert 1 < found.attrs["passes"] < 12
    assert found.attrs["chi2"] < 1.4 * found.attrs["measured"]


def test_a_parameter_is_found_together_with_the_hits():
    found = find(KNOWING, structure(joint=True), recording()[0])
    assert score(found) == 1
    k, std = (float(found[v].sel(state="k")[-1]) for v in ("x_hat", "x_std"))
    assert abs(k - 1) < min(0.02, 4 * std)


def test_it_is_least_squares_on_the_motion():
    """Given where the hits are: first state, sizes, and their covariance, from the motion alone."""
    data, d = recording()
    u, y = data["u"].values, data["y"].values
    seen = np.isfinite(y)

    def residual(z):
        force = np.zeros_like(d)
        for i, place in enumerate(HITS):
            force[place] = z[5 + i]
        e = (moved(z[:4], u, force, z[4])[:, :2] @ SENSORS.T - y)[seen] / 1e-4
        return np.concatenate([z[:4] / 2e-4, [(z[4] - 0.6) / 0.5], e])

    start = [0, 0, 0, 0, 1, *HITS.values()]
    best = scipy.optimize.least_squares(residual, start, x_scale=[1e-4] * 4 + [1, 10, 10])
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    found = find(KNOWING, structure(joint=True), data, selection=bs.forces.Given(d))
    std = np.sqrt(np.diag(covariance))
    values = [*found["x_hat"].values[0], *(found["d_hat"].values[p] for p in HITS)]
    np.testing.assert_allclose((values - best.x) / std, 0, atol=0.02)
    shown = [*found["x_std"].values[0], *(found["d_std"].values[p] for p in HITS)]
    np.testing.assert_allclose(shown, std, rtol=0.02)


def test_a_model_that_hardly_bends_is_the_linear_one():
    data = recording()[0]
    linear = find(METHOD, structure(0.0), data, selection=bs.forces.L1())
    bent = find(METHOD, structure(1e-20), data, selection=bs.forces.L1())
    assert bent.attrs["passes"] == 2
    for name in ("x_hat", "P", "d_hat", "d_std", "y_hat", "e", "S"):
        # Runge-Kutta here, the matrix exponential there.
        expected = np.nan_to_num(linear[name].values)
        close = 2e-4 * np.abs(expected).max()
        np.testing.assert_allclose(np.nan_to_num(bent[name].values), expected, atol=close)


def test_what_does_not_settle_is_told(monkeypatch):
    monkeypatch.setattr(sparse_forces, "PASSES", 2)
    with pytest.warns(BacksightWarning, match="still change after 2 linearisations"):
        find(METHOD, structure(), recording()[0])


def test_interpolated_inputs_are_refused():
    with pytest.raises(TuningError, match="hold 'foh' needs a linear model"):
        find(dataclasses.replace(METHOD, hold="foh"), structure(), recording()[0])


def test_noise_that_would_not_be_kept_is_refused():
    """By the search as by the window."""
    gated = bs.Noise(sigma_y=1e-4, outliers=bs.settings.Gate())
    unsure = bs.Noise(sigma_y=1e-4, sigma_u={"f": 0.1})
    for noise, told in ((gated, "take hits for outliers"), (unsure, "additive noise")):
        for model in (structure(), structure(0.0)):
            with pytest.raises(TuningError, match=told):
                find(dataclasses.replace(METHOD, noise=noise), model, recording()[0])
