"""How a model whose noise becomes states is carried from sample to sample."""

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.schema import INTEGRATION, Status

DT, N, K, C = 0.01, 60, 400.0, 2.0
PRIOR = bs.Prior(P0=np.diag([1e-4, 1e-2]))


def oscillator(k: float = K) -> bs.Model:
    """Linear in state and input; c multiplies a state, w is added to the force."""
    return bs.Model(
        f=lambda x, u, p: [x.v, -k * x.q - p.c * x.v + u.F + p.w + 3.0],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"c": C, "w": 0.0},
    )


def recording():
    rng = np.random.default_rng(0)
    u, y = np.cumsum(rng.standard_normal(N)), 1e-2 * rng.standard_normal(N)
    return bs.from_arrays(u=u, y=y, dt=DT, inputs={"F": "N"}, outputs={"y": "m"})


def run(integrator, *, k=K, **noise):
    noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}, **noise)
    estimator = bs.EKF(noise, PRIOR, integrator)
    return bs.estimate(estimator, oscillator(k), recording(), engine="vm")


@pytest.mark.parametrize(
    ("noise", "told"),
    [
        ({"sigma_u": 0.5}, "matrix exponential"),
        ({"sigma_p": {"w": 0.5}}, "matrix exponential"),
        ({"sigma_p": {"c": 0.5}}, "rk4"),
    ],
)
def test_the_step_is_exact_where_the_noise_is_added(noise, told):
    """Noise that multiplies a state has no matrix exponential; a constant force has one."""
    chosen, fine = run(bs.Integrator(), **noise), run(bs.Integrator("dopri5", 8), **noise)
    assert chosen.attrs[INTEGRATION].startswith(told)
    assert np.max(np.abs(chosen["x_hat"] - fine["x_hat"]) / fine["x_std"]) < 1e-2
    np.testing.assert_allclose(chosen["x_std"], fine["x_std"], rtol=1e-3)


def test_noise_of_the_input_is_noise_of_a_force():
    by_input, by_force = run(bs.Integrator(), sigma_u=0.5), run(bs.Integrator(), sigma_p={"w": 0.5})
    np.testing.assert_allclose(by_input["P"], by_force["P"], rtol=1e-9)
    np.testing.assert_allclose(by_input["x_hat"], by_force["x_hat"], rtol=1e-9, atol=1e-12)


def test_an_exact_step_is_refused_for_noise_that_multiplies_a_state():
    with pytest.raises(TuningError, match="'exact' is for models that are linear"):
        run(bs.Integrator("exact"), sigma_p={"c": 0.5})


@pytest.mark.parametrize(("steps", "coarse"), [(1, True), (8, False)])
def test_a_coarse_step_is_told_sample_by_sample(steps, coarse):
    """The recursion itself says so, as streams and exported C have it."""
    noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}, sigma_u=0.5)
    estimator = bs.EKF(noise, PRIOR, bs.Integrator("rk4", steps))
    recursion = estimator.compile(oscillator(4e4), DT)
    *_, status = recursion.step(recursion.carry0, ca.DM([0.0]), ca.DM([0.0]), ca.DM([1.0]))
    assert bool(int(status) & int(Status.COARSE_STEP)) == coarse
