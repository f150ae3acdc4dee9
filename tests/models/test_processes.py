"""Forces with dynamics against dense Gaussian-process regression, and loads that move."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import backsight as bs
from backsight.errors import ModelError
from backsight.forces import GaussMarkov, Matern, Periodic, moving_load
from closeness import assert_close
from relations.linear import Run

DT, N = 0.05, 40
TIMES = DT * np.arange(N)
KERNELS = {
    "gauss-markov": (GaussMarkov(3.0, 0.2), lambda t: 9 * np.exp(-abs(t) / 0.2)),
    "matern 3/2": (
        Matern(2.0, 0.3),
        lambda t: 4 * (1 + 3**0.5 * abs(t) / 0.3) * np.exp(-(3**0.5) * abs(t) / 0.3),
    ),
    "matern 5/2": (
        Matern(2.0, 0.3, "5/2"),
        lambda t: 4
        * (1 + 5**0.5 * abs(t) / 0.3 + 5 * t**2 / 0.27)
        * np.exp(-(5**0.5) * abs(t) / 0.3),
    ),
    "periodic": (
        Periodic(1.5, 2.0, orders=(1, 2.5), memory=0.8),
        lambda t: 2.25 / 2 * np.exp(-abs(t) / 0.8)
        * (np.cos(4 * np.pi * t) + np.cos(10 * np.pi * t)),
    ),
    "lasting": (Periodic(1.5, 2.0), lambda t: 2.25 * np.cos(4 * np.pi * t)),
}  # fmt: skip


def force_seen(dt: float | None = None) -> bs.Model:
    """A force that is measured, and the way of what it drives: its integral."""
    return bs.Model(
        f=lambda x, u, p: [p.F] if dt is None else [x.w + p.F],
        h=lambda x, u, p: [p.F, x.w],
        states={"w": "N s"},
        outputs={"y": "N", "z": "N s"},
        parameters={"F": (0.7, "N")},
        dt=dt,
    )


def regression(gram, cross, prior, y, sigma, mean=0.0):
    """Mean and standard deviation of a Gaussian process by dense conditioning."""
    S = gram + sigma**2 * np.eye(len(y))
    x = mean + cross @ np.linalg.solve(S, y - mean)
    return x, np.sqrt(prior - np.einsum("ij,ji->i", cross, np.linalg.solve(S, cross.T)))


@pytest.mark.parametrize("kind", KERNELS)
@pytest.mark.parametrize("dt", [None, DT])
def test_smoothing_is_gaussian_process_regression(kind, dt):
    """With times of measurements left out, continuous and discrete models alike."""
    process, kernel = KERNELS[kind]
    joint = bs.augment(force_seen(dt), forces={"F": process})
    y = np.random.default_rng(1).standard_normal((N, 2))
    y[:, 1] = np.nan
    y[10:17, 0] = np.nan
    seen = np.flatnonzero(np.isfinite(y[:, 0]))
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={"y": "N", "z": "N s"})
    e = bs.KalmanFilter(bs.Noise(sigma_y=0.5), bs.Prior(sigma_x0={"w": 0.0}))
    result = bs.smooth(e, joint, recording, engine="vm")
    k = kernel(TIMES[:, None] - TIMES)
    mean, std = regression(k[np.ix_(seen, seen)], k[:, seen], kernel(0.0), y[seen, 0], 0.5, 0.7)
    F = list(result.state.values).index("F")
    assert_close(result.x_hat.values[:, F], mean, 1e-9)
    assert_close(result.x_std.values[:, F], std, 1e-9)


@pytest.mark.parametrize("kind", ["gauss-markov", "matern 3/2", "matern 5/2", "periodic"])
def test_what_a_force_drives_is_regression_of_its_integral(kind):
    """The noise of the force goes through the model between the samples, by quadrature."""
    process, kernel = KERNELS[kind]
    joint = bs.augment(force_seen(), forces={"F": process})
    y = np.random.default_rng(2).standard_normal((N, 2)) * 0.1 + 0.7 * TIMES[:, None]
    y[:, 0] = np.nan
    recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs={"y": "N", "z": "N s"})
    e = bs.KalmanFilter(bs.Noise(sigma_y=[1.0, 0.1]), bs.Prior(sigma_x0={"w": 0.0}))
    result = bs.smooth(e, joint, recording, engine="vm")

    # Cells of the double integral of the covariance, by Gauss-Legendre; triangles on the diagonal.
    g, weight = np.polynomial.legendre.leggauss(24)
    lag = DT * np.arange(N - 1)[:, None]
    s = DT * (g + 1) / 2
    # Over a cell: integral of k(lag + r) (DT - |r|) dr, r from -DT to DT, in two smooth halves.
    cell = (DT / 2 * weight * (DT - s) * (kernel(lag + s) + kernel(abs(lag - s)))).sum(axis=1)
    mean_of = (DT / 2 * weight * kernel(abs(DT * np.arange(-N, N)[:, None] + s))).sum(axis=1)
    cells = cell[abs(np.arange(N - 1)[:, None] - np.arange(N - 1))]
    below = np.tri(N, N - 1, -1)
    gram = below @ cells @ below.T
    strip = mean_of[(np.arange(N - 1) - np.arange(N)[:, None]) + N]
    cross = strip @ below.T
    z = y[:, 1] - 0.7 * TIMES
    mean, std = regression(gram, cross, kernel(0.0), z, 0.1)
    F = list(result.state.values).index("F")
    assert_close(result.x_hat.values[:, F], mean + 0.7, 1e-7)
    assert_close(result.x_std.values[:, F], std, 1e-7)


@pytest.mark.parametrize("kind", ["gauss-markov", "matern 3/2", "matern 5/2", "periodic"])
def test_the_prior_is_stationary(kind):
    process, _ = KERNELS[kind]
    z = ca.SX.sym("z", len(process.endings))
    F = np.array(ca.evalf(ca.jacobian(process.rates(z, None), z)))
    P = solve_continuous_lyapunov(F, -process.density)
    assert_close(P, process.stationary, 1e-9)


def test_orders_of_a_speed_that_is_recorded():
    """A chirp: with the speed as an input the model is linear in its states."""
    n, dt = 400, 0.01

    def truth(t):
        angle = 2 * np.pi * (3 * t + t**2 / 2)
        return 2 * np.cos(angle) - 1.5 * np.sin(2 * angle)

    plain = bs.Model(
        f=lambda x, u, p: [x.v, -400 * x.q - 4 * x.v + p.F], h=lambda x, u, p: [x.v],
        states={"q": "m", "v": "m/s"}, inputs={"n": "Hz"}, outputs={"y": "m/s"},
        parameters={"F": (0.0, "N")},
    )  # fmt: skip
    joint = bs.augment(plain, forces={"F": Periodic(2.0, "n", orders=(1, 2))})
    assert [s.name for s in joint.states] == [
        "q", "v", "F", "F_order1_quadrature", "F_order2", "F_order2_quadrature",
    ]  # fmt: skip
    times = dt * np.arange(n)
    hertz = (3 + times)[:, None]
    y = bs.simulate(plain, hertz, dt=dt, disturbances={"v": truth}, substeps=50, hold="foh")[
        "y"
    ].values
    e = bs.KalmanFilter(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0={"q": 1e-3, "v": 1e-2}), "foh")
    result = Run(e, joint, dt)(hertz, y)
    error = result["x_hat"][50:, 2] - truth(times[50:])
    band = np.sqrt(result["P"][50:, 2, 2])
    assert band[-1] < 0.01
    assert (np.abs(error) < 0.05 * band).all()  # nothing but the noise, of which there is none


def test_forces_go_with_noise_that_is_not_additive_and_with_the_extended_filter():
    """The same estimates by the filter that makes states of noise, and by linearisation."""
    joint = bs.augment(force_seen(), forces={"F": Matern(2.0, 0.3)})
    y = np.random.default_rng(3).standard_normal((N, 2))
    prior, R = bs.Prior(sigma_x0={"w": 0.1}), np.diag([0.25, 0.04])
    plain = Run(bs.KalmanFilter(bs.Noise(R=R, sigma_w={"w": 1e-2}), prior), joint, DT)
    others = [
        bs.KalmanFilter(
            bs.Noise(R=R, sigma_w={"w": 1e-2}, cross=np.zeros((3, 2))), prior
        ),
        bs.EKF(bs.Noise(R=R, sigma_w={"w": 1e-2}), prior),
        bs.MHE(bs.Noise(R=R, sigma_w={"w": 1e-2}), prior, N=5),
    ]  # fmt: skip
    none = np.zeros((N, 0))
    expected = plain(none, y)
    for e in others:
        found = Run(e, joint, DT)(none, y)
        np.testing.assert_allclose(found["x_hat"], expected["x_hat"], atol=2e-4, err_msg=e.key)
        np.testing.assert_allclose(found["P"], expected["P"], atol=2e-4, err_msg=e.key)


def test_a_disturbance_may_have_dynamics():
    plain = bs.sdof(k=100.0, b=1.0)
    joint = bs.augment(plain, disturbances={"w": "v"}, forces={"w": GaussMarkov(3.0, 0.1)})
    assert [s.name for s in joint.states] == ["q", "v", "w"]
    assert "w: Matérn 1/2, ± 3, 0.1 s" in str(joint)
    assert np.allclose(bs.Noise(sigma_y=1.0).density(joint)[2, 2], 2 * 9 / 0.1)
    assert np.allclose(bs.Prior(1.0).covariance(joint).diagonal(), [1, 1, 9])
    assert np.allclose(bs.Prior({"q": 1, "v": 1, "w": 5}).covariance(joint).diagonal(), [1, 1, 25])


def test_what_cannot_be_is_refused():
    with pytest.raises(ModelError, match="no parameter 'G'"):
        bs.augment(force_seen(), forces={"G": Matern(1.0, 1.0)})
    with pytest.raises(ModelError, match="a parameter and a force"):
        bs.augment(force_seen(), ["F"], forces={"F": Matern(1.0, 1.0)})
    with pytest.raises(ModelError, match="follows 'speed'"):
        bs.augment(force_seen(), forces={"F": Periodic(1.0, "speed")})


def bridge(places):
    return bs.beam(
        20.0, bending_stiffness=2e9, mass_per_length=5e3, boundary="pinned-pinned", modes=3,
        damping=0.02, forces=places,
        sensors={"mid": ("displacement", 10.0), "a": ("acceleration", 7.0)},
    )  # fmt: skip


def test_a_load_moves_along_the_shapes():
    places = {f"F{i}": float(i) for i in range(1, 20)}
    model = moving_load(bridge(places), "P", position="s", along=places, supports=(0.0, 20.0))
    for at in (0.3, 7.77, 19.2):
        there = bridge({"F": at})
        for equation, exact in ((model.f, there.f), (model.h, there.h)):
            load = np.array(equation([0] * 6, [at], [1e4]))
            np.testing.assert_allclose(
                load, np.array(exact([0] * 6, [], [1e4])), atol=1e-3 * 1e4 * math.sqrt(2 / 1e5)
            )
    assert not np.array(model.f([0] * 6, [20.1], [1e4])).any()


def test_the_weight_of_a_vehicle_is_found():
    places = {f"F{i}": float(i) for i in range(1, 20)}
    model = moving_load(bridge(places), "P", position="s", along=places, supports=(0.0, 20.0))
    dt, n = 0.01, 120
    way = 18.0 * dt * np.arange(n)
    truth = bs.simulate(
        model, {"s": way}, dt=dt, parameters={"P": 2.5e5}, sigma_y=[1e-5, 1e-2], hold="foh",
        substeps=4,
    )  # fmt: skip
    joint = bs.augment(model, ["P"])
    prior = bs.Prior(sigma_x0={s.name: 1e-3 for s in joint.states if s.name != "P"} | {"P": 1e6})
    noise = bs.Noise(sigma_y=[1e-5, 1e-2], sigma_w={"q1_dot": 1e-4})
    result = Run(bs.KalmanFilter(noise, prior, hold="foh"), joint, dt)(
        way[:, None], truth["y"].values
    )
    estimate, std = result["x_hat"][-1, -1], math.sqrt(result["P"][-1, -1, -1])
    assert abs(estimate - 2.5e5) < 3 * std < 1e4
