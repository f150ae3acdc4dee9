"""Single operations against values from an independent implementation (`stage_values.json`)."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from backsight.algebra.symmetric import unvech
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.estimators import EKF, Noise, Prior
from backsight.estimators.kalman.ekf import correct
from backsight.estimators.kalman.prediction import predict
from backsight.estimators.mho import window_cost
from backsight.estimators.parts.covariance import packed
from backsight.estimators.parts.flags import Flags
from backsight.models.lti import lti
from backsight.schema import Status
from backsight.solvers.box.gauss_newton import GaussNewton, minimise
from oracles.stage import DT, HEUN, NOISE, SU, SY, joint, scaled

VALUES = json.loads((Path(__file__).parent / "stage_values.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def stage():
    return scaled()


@pytest.fixture(scope="module")
def ahead(stage):
    """Time update of the paper: Heun's method, covariance equation."""
    return predict(stage, HEUN, "ode")


def number(expression: ca.SX | ca.DM) -> np.ndarray:
    """Value of an expression without symbols; a column as a flat array."""
    value = np.asarray(ca.evalf(ca.SX(expression)))
    return value[:, 0] if value.shape[1] == 1 else value


def full(P: ca.DM) -> np.ndarray:
    return number(unvech(ca.SX(P)))


def test_scaled_tuning(stage):
    v = VALUES["Q_R_P0"]
    np.testing.assert_allclose(np.diag(stage.Qc), v["Q_diag"], rtol=1e-14)
    np.testing.assert_allclose(stage.R, [[v["R"]]], rtol=1e-14)
    np.testing.assert_allclose(np.diag(stage.P0), v["P0_diag"], rtol=1e-14)
    np.testing.assert_allclose(stage.x0, v["x0"], rtol=1e-14)


def test_state_equation_and_heun(stage, ahead):
    v = VALUES["heun"]
    rhs = stage.model.rhs(ca.SX(v["x"]), ca.SX(v["us"]))
    np.testing.assert_allclose(number(rhs), v["rhs"], rtol=1e-12)
    u = ca.SX(v["us"])
    step = HEUN.substep(stage.model.rhs, ca.SX(v["x"]), ua=u, ub=u, h=v["h"])
    np.testing.assert_allclose(number(step), v["one_step"], rtol=1e-12)
    sample, _ = ahead(v["x"], packed(stage.P0), v["us"], v["us"])
    np.testing.assert_allclose(number(sample), v["one_sample"], rtol=1e-12)


def test_jacobian(stage):
    v = VALUES["jacobian_Z"]
    x, u = ca.SX.sym("x", 6), ca.SX.sym("u")
    Z = ca.Function("Z", [x, u], [ca.jacobian(stage.model.rhs(x, u), x)])(v["x"], v["us"])
    np.testing.assert_allclose(np.asarray(ca.densify(Z)), v["Z"], rtol=1e-12)


def test_first_covariance_by_heun(stage, ahead):
    v = VALUES["heun_cov_first_sample"]
    _, P = ahead(stage.x0, packed(stage.P0), v["us"], v["us"])
    np.testing.assert_allclose(full(P), v["P_minus"], rtol=1e-11, atol=1e-20)


def test_two_filter_steps(stage, ahead):
    v = VALUES["ekf_two_steps"]
    update, R = correct(stage), stage.R[0, 0]
    x, P = ca.DM(stage.x0), packed(stage.P0)
    for k, (u, y) in enumerate(zip(v["us"], v["ys"], strict=True), start=1):
        x, P, flags = update(*ahead(x, P, u, u), u, y, 1)
        np.testing.assert_allclose(number(x), v[f"x_plus_{k}"], rtol=1e-10)
        # K = P+ H' / R for one output.
        np.testing.assert_allclose(full(P)[:, 0] / R, v[f"K_{k}"], rtol=1e-8, atol=1e-13)
        assert not number(flags).any()
        if k == 1:
            np.testing.assert_allclose(full(P), v["P_plus_1"], rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(np.diag(full(P)), v["P_plus_2_diag"], rtol=1e-10)


def test_clipping_of_a_negative_stiffness(stage, ahead):
    v = VALUES["clipping"]
    P = np.diag(v["P_diag"])
    P[0, 2] = P[2, 0] = v["P02"]
    prior = ahead(v["x"], packed(P), v["us"], v["us"])
    x, P_post, flags = correct(stage)(*prior, v["us"], v["ys"], 1)
    np.testing.assert_allclose(number(x), v["clipped"], atol=1e-9)
    assert float(Flags.of(flags).status()) == Status.CLIPPED
    assert full(P_post)[2, 2] > 0


@pytest.mark.parametrize(
    ("covariance", "scheme", "substeps", "gain", "tolerance"),
    [
        ("transition", "rk4", 200, "K_dare", 1e-5),
        ("ode", "rk4", 32, "K_dare", 2e-8),
        ("ode", "heun", 8, "K_heun_ekf_after_6000_steps", 1e-9),
        ("transition", "heun", 8, "K_heun_ekf_after_6000_steps", 0.02),
    ],
)
def test_stationary_gain(covariance, scheme, substeps, gain, tolerance):
    """Known parameters: the filter becomes the stationary Kalman filter of the Riccati equation."""
    v = VALUES["steady_state_gain_DARE"]
    k, b, c, _ = v["params_physical"]
    q, speed = VALUES["heun"]["scales"][:2]
    model = lti(
        [[0.0, speed / q], [-k * q / speed, -b]],
        [[0.0], [c * SU / speed]],
        [[1.0, 0.0]],
        states={"q": "", "v": ""},
        inputs={"V": ""},
        outputs={"y": ""},
    )
    noise = Noise(R=np.array([[v["R"]]]), Qc=np.diag(v["Q_density_diag"]))
    filter_ = EKF(noise, Prior(1.0), Integrator(scheme, substeps), covariance)
    recursion = filter_.compile(model, DT)
    zeros = np.zeros((1500, 1))
    _, outputs = vm.run(recursion, [zeros, zeros, zeros + 1], carry=recursion.carry0)
    P = recursion.channels[1].unpack(outputs[1])[-1]
    np.testing.assert_allclose(P[:, 0] / v["R"], v[gain], rtol=tolerance)


@pytest.mark.parametrize("alpha", [1.0, 1e-4])
def test_window(stage, alpha):
    """Response, cost, last row of the sensitivities and minimiser of one window, eq. 26-28."""
    v = VALUES["mho_window"]
    w = VALUES["mho_window"][f"alpha={alpha:g}"]
    i = np.arange(v["N"] + 1)
    U = 0.4 * np.sin(0.9 * i)[None]
    clean = rollout(stage, v["x_true"], U[0])
    np.testing.assert_allclose(clean, v["rollout_x_true"], rtol=1e-12)
    Y = (clean + 2e-4 * np.cos(2.1 * i))[None]
    P = np.diag(np.square(v["P_diag_sqrt"]))
    P[1, 2] = P[2, 1] = 0.3 * 1e-2 * 2e-2
    x_bar, R = np.array(v["xbar"]), stage.R[0, 0]
    loss = window_cost(stage, HEUN, N=v["N"], alpha=alpha)

    def paper_cost(x: np.ndarray) -> float:
        """Eq. 26 with S = R P^-1."""
        prior = R * (x - x_bar) @ np.linalg.solve(P, x - x_bar)
        return prior + 2 * R * float(loss(x, U, Y, np.ones_like(Y))[0])

    assert paper_cost(x_bar) == pytest.approx(w["J_at_xbar"], rel=1e-8)
    assert paper_cost(np.array(v["x_true"])) == pytest.approx(w["J_at_xtrue"], rel=1e-8)

    last_only = np.zeros_like(Y)
    last_only[0, -1] = 1
    _, c, _ = loss(x_bar, U, Y, last_only)
    error = Y[0, -1] - rollout(stage, v["xbar"], U[0])[-1]
    np.testing.assert_allclose(
        number(c) / (alpha * error / R), v["jac_last_row_at_xbar"], rtol=1e-9
    )

    minimum = minimise(loss, GaussNewton(), lower=stage.lower, upper=stage.upper, cost_unit=R)(
        1, x_bar, np.linalg.cholesky(P), U, Y, np.ones_like(Y)
    )
    x_star = number(minimum[0])
    np.testing.assert_allclose(x_star, w["x_star"], atol=1e-6)
    assert paper_cost(x_star) == pytest.approx(w["J_star"], rel=1e-8)


def rollout(stage, x0, u) -> np.ndarray:
    """Outputs of the window without noise, by the time update of the filter."""
    ahead, x, P = predict(stage, HEUN, "ode"), ca.DM(x0), packed(0 * stage.P0)
    outputs = []
    for value in u:
        outputs.append(float(stage.model.h(x, value, stage.model.theta)))
        x, P = ahead(x, P, value, value)
    return np.array(outputs)


def test_outputs_are_physical(stage):
    """The first filtered sample in micrometres, from the scaled values of the two-step oracle."""
    v = VALUES["ekf_two_steps"]
    recursion = EKF(NOISE, Prior(P0=np.zeros((6, 6))), HEUN, "ode").compile(joint(), DT)
    data = [np.array([[v["us"][0] * SU]]), np.array([[v["ys"][0] * SY]]), np.ones((1, 1))]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    np.testing.assert_allclose(outputs[3], [[v["ys"][0] * SY]], rtol=1e-14)
    np.testing.assert_allclose(outputs[0], [[0, 0, 6e6, 70, 5e5, 0]], rtol=1e-14)
