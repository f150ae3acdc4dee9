"""A fixed effort: the same estimate where it suffices, and a status where it does not."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.engine import vm
from backsight.estimators import MHE, MHO
from backsight.schema import Status
from backsight.settings import GaussNewton
from backsight.testing import TrialProblem
from estimators import struck

DT = 0.02


def run(estimator, model, u, y, dt):
    recursion = estimator.compile(model, dt)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def limited(found):
    """Samples with the status *iteration limit*."""
    return (found["status"].astype(int) & int(Status.ITERATION_LIMIT)) > 0


@pytest.mark.parametrize("method", [MHE, MHO])
def test_active_limits_in_few_passes(method):
    problem = TrialProblem()
    data = problem.simulate(12, seed=5, hold="zoh", noisy=True)
    narrow = {"q": (-0.01, 0.01), "k": (119.0, 121.0)}
    states = tuple(
        dataclasses.replace(s, lower=narrow[s.name][0], upper=narrow[s.name][1])
        if s.name in narrow
        else s
        for s in problem.model.states
    )
    model = dataclasses.replace(problem.model, states=states)
    prior = dataclasses.replace(problem.prior, x0={"q": 0.0, "k": 120.0})

    def found(iterations, passes):
        optimiser = GaussNewton(iterations, tolerance=0.0, active_set_passes=passes)
        estimator = method(problem.noise, prior, N=3, optimiser=optimiser)
        return run(estimator, model, data.u, data.y, DT)

    free, enough, one = found(3, None), found(3, 8), found(1, 1)
    assert not limited(free).any()
    for name, values in free.items():
        if name != "passes":
            np.testing.assert_allclose(enough[name], values, rtol=0, atol=1e-12)
    at_a_limit = np.abs(np.abs(free["x_hat"][:, 0]) - 0.01) < 1e-12
    assert at_a_limit.any()
    assert limited(one).any()
    for i, s in enumerate(states):
        assert np.all((one["x_hat"][:, i] >= s.lower) & (one["x_hat"][:, i] <= s.upper))


def test_forces_in_few_steps():
    of = struck.system()
    model, (u, y) = struck.model(of), struck.record(of, 14, seed=2)
    given = {"forces": struck.FORCES, "lam": 0.1, "N": 4, "sigma_force": struck.SIGMA_FORCE}
    plain = bs.CompressiveSensingMHE(**struck.gaussians(of), **given)
    free = run(plain, model, u, y, struck.DT)
    assert not limited(free).any()
    assert free["steps"].max() > 3
    enough = run(dataclasses.replace(plain, max_steps=400), model, u, y, struck.DT)
    for name, values in free.items():
        np.testing.assert_array_equal(enough[name], values, err_msg=name)
    few = run(dataclasses.replace(plain, max_steps=2), model, u, y, struck.DT)
    assert few["steps"].max() <= 3
    assert limited(few).any()
    small = run(dataclasses.replace(plain, max_active=1), model, u, y, struck.DT)
    assert small["nonzeros"].max() == 1
    assert limited(small).any()
