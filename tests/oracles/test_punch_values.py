"""Single operations on the punch against values from an independent implementation."""

import dataclasses
import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.estimators import EKF, UKF, Noise, Prior
from backsight.estimators.observers import AdaptiveGain
from backsight.estimators.observers._formulas import ObserverGains, observer_rhs
from backsight.models.augment import augment
from backsight.models.canonical.affine import affine_form
from backsight.models.canonical.observer_form import gain_vector
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.views.scale import scale
from backsight.signals import punch_strokes
from backsight.tune import propose_gamma
from backsight_studies.punch.plant import (
    PERIOD,
    READINGS,
    SOFT,
    friction,
    punch,
    simulate_punch,
)
from backsight_studies.punch.tuning import filter_model

VALUES = json.loads((Path(__file__).parent / "punch_values.json").read_text(encoding="utf-8"))
DT = 1e-4


@pytest.fixture(scope="module")
def motions():
    return {reading.name: simulate_punch(reading, seconds=0.61) for reading in READINGS}


def joint(reading):
    """The model whose combinations of parameters are c/m, d/m, 1/m, as in the values."""
    return augment(punch(reading), ["c", "d", "m"])


def test_strokes():
    v = VALUES["s_curve"]
    # The values were taken a picosecond after the sample.
    motion = punch_strokes().at(np.array(v["t"]) + 1e-12)
    np.testing.assert_allclose(motion.position, v["r"], rtol=0, atol=1e-18)
    np.testing.assert_allclose(motion.velocity, v["v"], rtol=0, atol=1e-15)
    np.testing.assert_allclose(motion.acceleration, v["acc"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("reading", READINGS, ids=lambda r: r.name)
def test_plant_with_its_controller(motions, reading):
    v, motion = VALUES[f"meap_truth_{reading.name}"], motions[reading.name]
    rows = motion.isel(time=v["k"])
    for state, name in (("q", "x1"), ("v", "x2")):
        x = rows["x_true"].sel(state=state).values
        np.testing.assert_allclose(x, v[name], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(rows["u"].values[:, 0], v["F"], rtol=1e-10)


@pytest.mark.parametrize("name", ["consistent", "printed"])
def test_right_hand_side_of_the_observer(name):
    v = VALUES[f"ahg_rhs_{name}"]
    form = affine_form(joint(SOFT))
    order = [form.combinations.index(c) for c in ("c/m", "d/m", "1/m")]
    back = np.argsort(order)
    z = np.array(v["z"])
    gains = ObserverGains(
        np.array(v["k0"], float), np.diag(np.array(v["Gamma_diag"])[back]), name == "consistent"
    )
    upsilon = z[5:].reshape(2, 3)[:, back]
    rhs = observer_rhs(form, gains)(z[:2], z[2:5][back], upsilon, v["y"], v["F"], v["lam"], 1)
    dx, dtheta, dupsilon = (np.asarray(r) for r in rhs)
    found = np.concatenate([dx[:, 0], dtheta[order, 0], dupsilon[:, order].ravel()])
    np.testing.assert_allclose(found, v["zdot"], rtol=1e-12)


def test_eigenvalues_of_the_error():
    v = VALUES["hg_eigenvalues"]
    lam, k0 = v["lam"], gain_vector(-1.0, 2)
    np.testing.assert_array_equal(k0, [2.0, 1.0])
    A = np.array([[0.0, 1.0], [0.0, 0.0]]) - lam * np.outer([1.0, lam] * k0, [1.0, 0.0])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A).real), np.sort(v["eig"]), rtol=1e-7)


def test_stationary_upsilon():
    v = VALUES["upsilon_steady_state"]
    U = np.array([v["U1"], v["U2"]])
    form = affine_form(joint(SOFT))
    order = [form.combinations.index(c) for c in ("c/m", "d/m", "1/m")]
    q, speed, force = v["psi"]
    F = force + 30.0 * np.tanh(50.0 * -speed)
    gains = ObserverGains(gain_vector(-1.0, 2), np.eye(3))
    *_, dU = observer_rhs(form, gains)(
        [-q, -speed], [1, 1, 1], U[:, np.argsort(order)], 0, F, 70, 1
    )
    np.testing.assert_allclose(np.asarray(dU), 0.0, atol=1e-9)


def test_switch_of_the_adaptive_gain():
    v = VALUES["innovation_S"]
    gain = AdaptiveGain(lower=1.0, gamma=v["gamma"], beta=v["beta"])
    found = [float(ca.evalf(gain.sigmoid(ca.SX(i)))) for i in v["Inn"]]
    np.testing.assert_allclose(found, v["S"], rtol=1e-12)


def with_combinations() -> Model:
    """The model whose parameters are c/m, d/m and 1/m."""
    sizes = VALUES["joint_model_par1"]["scales"]
    names = ("q", "v", "stiffness", "damping", "inverse")
    return Model(
        f=lambda x, u, p: [
            x.v,
            -x.stiffness * x.q - x.damping * x.v + x.inverse * (u.F - friction(x.v)),
            0,
            0,
            0,
        ],
        h=lambda x, u, p: [x.q],
        states={n: Signal(scale=s) for n, s in zip(names, sizes, strict=True)},
        inputs={"F": "N"},
        outputs={"y": "m"},
    )


@pytest.mark.parametrize("case", [0, 1])
def test_joint_model(case):
    v = VALUES[f"joint_model_par{case}"]
    model = scale(filter_model(SOFT) if case == 0 else with_combinations())
    x, u = ca.SX.sym("x", 5), ca.SX.sym("u")
    rhs = model.rhs(x, u)
    step = Integrator("rk4").substep(model.rhs, x, ua=u, ub=u, h=DT)
    f = ca.Function("f", [x, u], [rhs, ca.jacobian(rhs, x), step])
    value, slope, after = (np.asarray(r) for r in f(v["X_scaled"], v["F"]))
    np.testing.assert_allclose(value[:, 0], v["f"], rtol=1e-12)
    np.testing.assert_allclose(slope, v["jac"], rtol=1e-11)
    np.testing.assert_allclose(after[:, 0], v["rk4_1e_4"], rtol=1e-12)


@pytest.mark.parametrize(("kind", "tolerance"), [(EKF, 1e-5), (UKF, 1e-12)])
def test_one_step_of_a_filter(kind, tolerance):
    """The values of the EKF are for another discretisation of its covariance, of the same order."""
    v = VALUES["ekf5_one_step"]
    expected = VALUES[f"{kind.key}5_one_step"]
    sizes = np.array(VALUES["joint_model_par0"]["scales"])
    density = np.diag(v["Qc_diag"] * sizes**2)
    # The values of the UKF are for noise that is added once per sample.
    walk = {"Q": density * DT} if kind is UKF else {"Qc": density}
    noise = Noise(sigma_y=1e-6, **walk)
    prior = Prior(x0=v["X"] * sizes, P0=np.diag(v["P_diag"] * sizes**2))
    model = filter_model(SOFT)
    free = tuple(dataclasses.replace(s, lower=-np.inf) for s in model.states)
    recursion = kind(noise, prior, Integrator("rk4", 1)).compile(
        dataclasses.replace(model, states=free), DT
    )
    data = [np.full((2, 1), v["F"]), np.array([[0.0], [v["y"]]]), np.array([[0.0], [1.0]])]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    P = recursion.channels[1].unpack(outputs[1])[1] / np.outer(sizes, sizes)
    np.testing.assert_allclose(outputs[0][1] / sizes, expected["X_plus"], rtol=1e-9)
    np.testing.assert_allclose(np.diag(P), expected["P_plus_diag"], rtol=tolerance)


@pytest.mark.parametrize("name", ["soft", "stiff", "soft_s4", "stiff_s4"])
def test_proposed_gamma(motions, name):
    v = VALUES["Gamma"][name]
    reading = next(r for r in READINGS if r.stiffness == v["stiffness"])
    model = joint(reading)
    order = [affine_form(model).combinations.index(c) for c in ("c/m", "d/m", "1/m")]
    settings = {"gain": v["lam"], "rate": v["rate"], "period": PERIOD}
    motion = motions[reading.name]
    full = propose_gamma(model, motion, **settings)[np.ix_(order, order)]
    diagonal = propose_gamma(model, motion, diagonal=True, **settings)[np.ix_(order, order)]
    size = np.sqrt(np.diag(v["Gamma"]))
    expected = v["Gamma"] / np.outer(size, size)
    np.testing.assert_allclose(full / np.outer(size, size), expected, rtol=0, atol=1e-3)
    np.testing.assert_allclose(diagonal, np.diag(v["diagonal"]), rtol=1e-3)
