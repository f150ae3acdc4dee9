"""The integration step: what it loses of a mode, and that it chooses itself to lose nothing."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs
from backsight.discrete.modes import Modes, modes_over
from backsight.discrete.runge_kutta import TABLEAUS, Integrator
from backsight.discrete.steps import (
    ACCURATE,
    accuracy,
    advanced,
    choose,
    complaint,
    over_sample,
    steps_needed,
)
from backsight.errors import TuningError
from backsight.models.lti import lti
from backsight.models.model import Model

DT = 0.01


def spinning(mode: complex) -> np.ndarray:
    """A real matrix with the eigenvalue `mode` and its conjugate."""
    return np.array([[mode.real, mode.imag], [-mode.imag, mode.real]])


def integrated(A: np.ndarray, scheme: str, steps: int) -> np.ndarray:
    """Transition matrix over DT by the method itself."""
    x = ca.SX.sym("x", len(A))
    end = x
    for _ in range(steps):
        end = Integrator(scheme, steps).substep(
            lambda v, _: ca.DM(A) @ v, end, ua=ca.SX(), ub=ca.SX(), h=DT / steps
        )
    return np.array(ca.evalf(ca.jacobian(end, x)))


def one(mode: complex) -> Modes:
    return Modes(np.array([mode]), ("'x'",))


@pytest.mark.parametrize("scheme", sorted(TABLEAUS))
@pytest.mark.parametrize("mode", [-30 + 0j, -5 + 140j, -700 + 0j, 20 + 3j])
@pytest.mark.parametrize("steps", [1, 3])
def test_what_is_lost_is_what_the_method_loses(scheme, mode, steps):
    """Against the matrix exponential: both matrices are normal, so that norms are moduli."""
    A = spinning(mode)
    off = np.linalg.norm(integrated(A, scheme, steps) - expm(A * DT), 2)
    found = accuracy(scheme, one(mode), dt=DT, steps=steps)
    expected = off / max(abs(np.exp(mode * DT)), 1.0)
    assert found.error == pytest.approx(expected, rel=1e-9, abs=1e-15)
    if mode.real < 0:
        grows = np.linalg.norm(integrated(A, scheme, steps), 2) > 1 + 1e-9
        assert found.stable == (not grows)


@pytest.mark.parametrize("scheme", ["rk4", "dopri5"])
@pytest.mark.parametrize("mode", [-900 + 0j, -20 + 900j, -3 + 40j])
def test_as_few_steps_as_are_needed(scheme, mode):
    n = steps_needed(scheme, one(mode), dt=DT)
    A = spinning(mode)
    assert np.linalg.norm(integrated(A, scheme, n) - expm(A * DT), 2) <= ACCURATE
    if n > 1:
        assert np.linalg.norm(integrated(A, scheme, n - 1) - expm(A * DT), 2) > ACCURATE


def with_gravity() -> Model:
    """Linear with a constant, a fast mode and a state that stands still."""
    return Model(
        f=lambda x, u, p: [x.v, -9.81 - 5e4 * x.q - 3 * x.v + p.c * u.F, 0],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s", "b": ""},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"c": 2.0},
    )


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_linear_models_are_carried_by_the_matrix_exponential(hold):
    model = with_gravity()
    chosen = choose(Integrator(hold=hold), model, lambda: one(-1.0), dt=DT)
    assert (chosen.scheme, chosen.steps) == ("exact", 1)
    x, a, b = (ca.SX.sym(n, k) for n, k in (("x", 3), ("a", 1), ("b", 1)))
    moved = ca.Function("m", [x, a, b], [advanced(chosen, model, x, ua=a, ub=b, h=DT)])
    block = np.zeros((6, 6))  # state, input, its slope, and one
    block[0, 1], block[1, :2] = 1, [-5e4, -3]
    block[1, 3], block[1, 5], block[3, 4] = 2, -9.81, 1
    slope = 0.0 if hold == "zoh" else (3.0 - 1.5) / DT
    expected = expm(block * DT) @ [0.01, 0.2, 7.0, 1.5, slope, 1.0]
    assert np.array(moved([0.01, 0.2, 7.0], 1.5, 3.0)).ravel() == pytest.approx(expected[:3])
    assert float(moved([0.01, 0.2, 0.1 + 0.2], 1.5, 3.0)[2]) == 0.1 + 0.2
    _, F, G = over_sample(chosen, model, DT)([0.01, 0.2, 7.0], 1.5, 1.5)
    assert np.array(F) == pytest.approx(expm(block * DT)[:3, :3], abs=1e-12)
    assert np.array(G).ravel() == pytest.approx(expm(block * DT)[:3, 3], abs=1e-12)


def duffing(k: float = 400.0, k3: float = 1e4) -> Model:
    return Model(
        f=lambda x, u, p: [x.v, -k * x.q - k3 * x.q**3 - 2 * x.v],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        outputs={"y": "m"},
    )


def test_the_range_of_the_prior_counts():
    """At two standard deviations the cubic spring is far stiffer; a bound cuts that off."""
    narrow = modes_over(duffing(), np.zeros(2), np.array([1e-3, 1.0]))
    wide = modes_over(duffing(), np.zeros(2), np.array([0.5, 1.0]))
    assert np.abs(narrow.values).max() == pytest.approx(20.0, rel=1e-2)
    assert np.abs(wide.values).max() == pytest.approx(np.sqrt(400 + 3e4), rel=1e-6)
    n, m = (
        choose(Integrator("rk4"), duffing(), lambda k=k: k, dt=DT).steps for k in (narrow, wide)
    )
    assert n < m


def test_the_cheaper_method_is_taken():
    modes = modes_over(duffing(4e5), np.zeros(2), np.array([1e-3, 1.0]))
    chosen = choose(Integrator(), duffing(4e5), lambda: modes, dt=DT)
    costs = {s: steps_needed(s, modes, dt=DT) * len(TABLEAUS[s].b) for s in ("rk4", "dopri5")}
    assert chosen.steps * len(TABLEAUS[chosen.scheme].b) == min(costs.values())


def test_explicit_choices_stay():
    for given in (Integrator("heun", 3, "foh"), Integrator("rk4", 1)):
        assert choose(given, duffing(), lambda: one(-1.0), dt=DT) == given
    assert choose(Integrator(substeps=2), duffing(), dict, dt=DT) == Integrator("rk4", 2)


def test_a_discrete_model_needs_no_step():
    """Its Jacobian is no rate; whatever is given is not judged, nor used."""
    model = lti(
        [[0.95]], [[1.0]], [[1.0]], states={"x": ""}, inputs={"u": ""}, outputs={"y": ""}, dt=1.0
    )
    recording = bs.from_arrays(
        u=np.zeros((20, 1)), y=np.zeros(20), inputs={"u": ""}, outputs={"y": ""}, dt=1.0
    )
    given = bs.Noise(sigma_y=1.0, sigma_w=1.0), bs.Prior(sigma_x0=1.0)
    for integrator in (Integrator("euler", 1), Integrator("rk4"), Integrator()):
        result = bs.estimate(bs.EKF(*given, integrator), model, recording, engine="vm")
        assert not result["status"].any()
        assert "integration" not in result.attrs


def test_too_stiff_for_every_explicit_method():
    modes = modes_over(duffing(1e11), np.zeros(2), np.zeros(2))
    with pytest.raises(
        TuningError, match=r"400 steps .* the mode of '[qv]' \(eigenvalue -1\+3.162e"
    ):
        choose(Integrator(), duffing(1e11), lambda: modes, dt=DT)
    with pytest.raises(TuningError, match="'exact' is for linear models"):
        choose(Integrator("exact"), duffing(), lambda: modes, dt=DT)


def test_a_coarse_choice_is_told_with_what_would_do():
    text = complaint(Integrator("rk4", 1), lambda: one(-20 + 90j), dt=DT)
    needed = steps_needed("rk4", one(-20 + 90j), dt=DT)
    assert "'x' (eigenvalue -20+90j 1/s)" in text
    assert f"use substeps = {needed} or 'auto'" in text
    assert "unstable" in complaint(Integrator("rk4", 1), lambda: one(-900 + 0j), dt=DT)
    assert complaint(Integrator("rk4", needed), lambda: one(-20 + 90j), dt=DT) == ""


def test_many_states_are_looked_at_in_few_places():
    n = 120
    A = -np.diag(np.arange(1.0, n + 1))
    model = lti(
        A, np.zeros((n, 1)), np.eye(1, n), states={f"x{i}": "" for i in range(n)},
        inputs={"u": ""}, outputs={"y": ""},
    )  # fmt: skip
    found = modes_over(model, np.zeros(n), np.ones(n))
    assert np.sort(found.values.real) == pytest.approx(-np.arange(1.0, n + 1)[::-1])


def test_wrong_settings():
    with pytest.raises(TuningError, match="substeps is 0; it must be a whole number from 1 on"):
        bs.Integrator(substeps=0)
    with pytest.raises(TuningError, match="unknown substeps 'some': known: auto"):
        bs.Integrator(substeps="some")
