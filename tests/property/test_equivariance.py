"""Names, order and units of the states are labels: estimates follow them and nothing else."""

import dataclasses
import itertools

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, MHO, Noise, Prior
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.testing import DT, WALK, R, TrialProblem, simulated
from closeness import assert_close
from relations.linear import Run

HELD = Integrator("rk4", 1, "zoh")
DATA = simulated(40, seed=1, hold="zoh", noisy=True)
DATA.y[5:8, 0] = np.nan
SIGMA_X0 = np.array([0.05, 0.5, 40.0])
METHODS = ("ekf", "mho")


def build(key: str, noise: Noise, prior: Prior) -> AbstractEstimator:
    if key == "ekf":
        return EKF(noise, prior, HELD)
    return MHO(noise, prior, N=5, alpha=0.5, integrator=HELD)


def permuted(model: Model, order: list[int]) -> Model:
    """The same model with its states in another order."""
    x, u, p = ca.SX.sym("x", 3), ca.SX.sym("u", 1), ca.SX.sym("p", len(model.parameters))
    original = x[np.argsort(order).tolist()]
    return dataclasses.replace(
        model,
        states=tuple(model.states[i] for i in order),
        f=ca.Function("f", [x, u, p], [model.f(original, u, p)[order]]),
        h=ca.Function("h", [x, u, p], [model.h(original, u, p)]),
    )


@pytest.mark.parametrize("key", METHODS)
@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[1:])
@pytest.mark.parametrize("bounds", [(1.0, 1e4), (100.0, 130.0)])
def test_order_of_the_states(key, order, bounds):
    order, model = list(order), TrialProblem(k_bounds=bounds).model
    noise, prior = Noise(R=R, sigma_w=WALK), Prior(sigma_x0=SIGMA_X0)
    expected = Run(build(key, noise, prior), model, DT)(DATA.u, DATA.y)
    turned = build(key, Noise(R=R, sigma_w=WALK[order]), Prior(sigma_x0=SIGMA_X0[order]))
    result = Run(turned, permuted(model, order), DT)(DATA.u, DATA.y)
    assert_close(result["x_hat"], expected["x_hat"][:, order], 1e-9)
    assert_close(result["P"], expected["P"][:, order][:, :, order], 1e-9)
    assert_close(result["e"], expected["e"], 1e-8)
    np.testing.assert_array_equal(result["status"], expected["status"])


@pytest.mark.parametrize("key", METHODS)
@settings(max_examples=8)
@given(
    length=st.floats(-9, 9),
    q=st.floats(-4, 4),
    v=st.floats(-4, 4),
    k=st.floats(-4, 4),
)
def test_units_and_scales(key, length, q, v, k):
    """Lengths from nanometres to gigametres, internal scales over eight decades."""
    base = TrialProblem()
    other = TrialProblem(length=10.0**length, scales={"q": 10.0**q, "v": 10.0**v, "k": 10.0**k})
    runs = [Run(build(key, p.noise, p.prior), p.model, DT) for p in (base, other)]
    scaled = DATA.scaled(other.length)
    expected, result = runs[0](DATA.u, DATA.y), runs[1](scaled.u, scaled.y)
    factors = other.factors
    assert_close(result["x_hat"], factors * expected["x_hat"], 1e-8)
    assert_close(result["P"], np.outer(factors, factors) * expected["P"], 1e-7)
    np.testing.assert_array_equal(result["status"], expected["status"])


def test_order_of_the_outputs():
    """Correlated noise and gaps move along with their channels."""
    model = TrialProblem().model
    swapped = dataclasses.replace(model, outputs=model.outputs[::-1], h=lambda x, u, p: [x.v, x.q])
    for key in METHODS:
        estimator = build(key, Noise(R=R, sigma_w=WALK), Prior(sigma_x0=SIGMA_X0))
        turned = dataclasses.replace(estimator, noise=Noise(R=R[::-1, ::-1], sigma_w=WALK))
        expected = Run(estimator, model, DT)(DATA.u, DATA.y)
        result = Run(turned, swapped, DT)(DATA.u, DATA.y[:, ::-1])
        assert_close(result["x_hat"], expected["x_hat"], 1e-9)
        assert_close(result["S"], expected["S"][:, ::-1, ::-1], 1e-9)
