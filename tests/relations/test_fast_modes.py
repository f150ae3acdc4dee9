"""Estimators with fast modes: on the truth by themselves, and with a word where they cannot be."""

import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs
from backsight.models.lti import state_space
from backsight.schema import Status

BEAM = bs.beam(
    0.405,
    width=0.025,
    thickness=0.003,
    youngs_modulus=65.9e9,
    density=7502.0,
    damping=[0.03, 0.037, 0.119],
    sensors={f"s{i}": ("displacement", x) for i, x in enumerate((0.245, 0.325, 0.405))},
    inputs={"F": 0.3},
)
NOISE = bs.Noise(sigma_y=1e-6, sigma_w=[0, 0, 0, 1e-5, 1e-5, 1e-5])
PRIOR = bs.Prior(sigma_x0=[1e-6] * 3 + [1e-4] * 3)


def struck(dt: float, n: int = 150):
    """The cantilever of the sparse-force paper under a random force, by its matrix exponential."""
    rng = np.random.default_rng(0)
    A, B, C, _ = state_space(BEAM)
    M = expm(np.block([[A, B], [np.zeros((1, 7))]]) * dt)
    u, x, X = np.repeat(rng.standard_normal(n // 4 + 1), 4)[:n, None] * 2, np.zeros(6), []
    for k in range(n):
        X.append(x)
        x = M[:6, :6] @ x + M[:6, 6:] @ u[k]
    X = np.array(X)
    y = X @ C.T + 1e-6 * rng.standard_normal((n, 3))
    outputs = {s.name: s.unit for s in BEAM.outputs}
    return X, bs.from_arrays(u=u, y=y, inputs={"F": "N"}, outputs=outputs, dt=dt)


@pytest.mark.parametrize("dt", [2.5e-3, 5e-3], ids=["400 Hz", "200 Hz"])
def test_a_linear_model_with_fast_modes_is_the_kalman_filters(dt):
    X, recording = struck(dt)
    kalman = bs.estimate(bs.KalmanFilter(NOISE, PRIOR), BEAM, recording, engine="vm")
    assert np.abs((kalman["x_hat"] - X) / kalman["x_std"]).max() < 6
    for made in (bs.EKF(NOISE, PRIOR), bs.UKF(NOISE, PRIOR), bs.MHE(NOISE, PRIOR, N=5)):
        result = bs.estimate(made, BEAM, recording, engine="vm")
        off = np.abs(result["x_hat"] - kalman["x_hat"]) / kalman["x_std"]
        assert off.max() < 1e-8, made.key
        assert not result["status"].any()
        assert result.attrs["integration"] == "matrix exponential, inputs held"


def test_a_coarse_step_is_told_before_q_and_r():
    _, recording = struck(2.5e-3)
    coarse = bs.EKF(NOISE, PRIOR, bs.Integrator("rk4", 1))
    found = bs.compare({"EKF": coarse}, BEAM, recording)
    assert (found["EKF"]["status"] & Status.COARSE_STEP).all()
    (verdict,) = (v for v in found.verdicts() if v.startswith("EKF"))
    step = verdict.index("the integration step, rk4 with 1 step per sample of 0.0025 s")
    assert "use substeps = 16 or 'auto'" in verdict
    assert step < min(verdict.find(word) for word in ("confident", "Q", "R ") if word in verdict)
    stream = bs.stream(coarse, BEAM, dt=2.5e-3)
    assert int(stream.step(u=[0.0], y=[0.0, 0.0, 0.0])["status"]) & Status.COARSE_STEP
    fine = bs.EKF(NOISE, PRIOR, bs.Integrator("rk4", 16))
    assert not bs.estimate(fine, BEAM, recording, engine="vm")["status"].any()


def hardening() -> bs.Model:
    """A slow Duffing oscillator with a fast appendage: 300 rad/s at 100 samples per second."""
    return bs.Model(
        f=lambda x, u, p: [
            x.v,
            u.F - 40 * x.q - 400 * x.q**3 - 0.5 * x.v - 9e4 * (x.q - x.r),
            x.w,
            9e4 * (x.q - x.r) * 4 - 20 * x.w,
        ],
        h=lambda x, u, p: [x.q, x.r],
        states={"q": "m", "v": "m/s", "r": "m", "w": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m", "z": "m"},
    )


@pytest.mark.parametrize("kind", ["ekf", "ukf", "mhe", "mho"])
def test_a_nonlinear_model_with_fast_modes(kind):
    """The reference is made with 200 steps of the method of highest order."""
    rng, dt, n, model = np.random.default_rng(1), 0.01, 60, hardening()
    u = 20 * rng.standard_normal((n, 1))
    recording = bs.simulate(
        model, u, dt=dt, x0=[0.1, 0.0, 0.1, 0.0], sigma_y=1e-3, seed=2, substeps=200
    )
    noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-2, "w": 1e-2})
    prior = bs.Prior(sigma_x0=[0.05, 0.5, 0.05, 0.5], x0={"q": 0.1, "r": 0.1})
    build = {
        "ekf": lambda i: bs.EKF(noise, prior, i),
        "ukf": lambda i: bs.UKF(noise, prior, i),
        "mhe": lambda i: bs.MHE(noise, prior, N=5, integrator=i),
        "mho": lambda i: bs.MHO(noise, prior, N=5, integrator=i),
    }[kind]
    own, fine, poor = (
        bs.estimate(build(i), model, recording, engine="vm", throw=False)
        for i in (bs.Integrator(), bs.Integrator("dopri5", 200), bs.Integrator("rk4", 1))
    )
    size = np.sqrt((fine["x_hat"] ** 2).mean("time"))
    assert (np.abs(own["x_hat"] - fine["x_hat"]).max("time") < 0.01 * size).all()
    assert not own["status"].any()
    assert (poor["status"] & Status.COARSE_STEP).all()


def test_a_stiff_pole_beside_a_slow_mass():
    """3 times as fast as the sampling: Runge-Kutta of order 4 in one step is unstable."""
    lam, dt = 300.0, 0.01
    model = bs.lti(
        [[-lam, 0], [1, 0]], [[1], [0]], [[0, 1]], states={"a": "", "b": ""},
        inputs={"u": ""}, outputs={"y": ""},
    )  # fmt: skip
    y = 0.1 * np.random.default_rng(0).standard_normal(100)
    recording = bs.from_arrays(u=np.ones((100, 1)), y=y, inputs={"u": ""}, outputs={"y": ""}, dt=dt)
    noise, prior = bs.Noise(sigma_y=0.1, sigma_w=[0.1, 0.1]), bs.Prior(sigma_x0=[0.1, 1.0])
    kalman = bs.estimate(bs.KalmanFilter(noise, prior), model, recording, engine="vm")
    own = bs.estimate(bs.EKF(noise, prior), model, recording, engine="vm")
    assert own["x_hat"].values == pytest.approx(kalman["x_hat"].values, abs=1e-12)
    assert own["P"].values == pytest.approx(kalman["P"].values, abs=1e-12)


def test_observers_choose_for_their_own_modes_too():
    """The gain makes a mode faster than those of the model."""
    model = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - 0.5 * x.v],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        outputs={"y": "m"},
        parameters={"k": 40.0},
    )
    given = bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=0.1)
    slow, fast = (bs.HGO(*given, gain=g).chosen(model, 0.01).steps for g in (5.0, 200.0))
    assert slow < fast
    bs.HGO(*given, gain=2000.0).compile(model, 0.01)  # refused with one step
    with pytest.raises(bs.errors.TuningError, match="too large for steps"):
        bs.HGO(*given, gain=2000.0, integrator=bs.Integrator("rk4", 1)).compile(model, 0.01)
