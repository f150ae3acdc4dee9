"""What a user may rely on: honest estimates, whatever the units, gaps and bounds."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from backsight.errors import EstimationError
from backsight.estimators import Noise, Prior
from backsight.run.estimation import estimate
from backsight.schema import Status, check_result
from closeness import assert_close
from contract.cases import DT, K_TRUE, Data, Problem, R


def test_result_has_the_schema(build, problem, hold):
    data, model = problem.simulate(20, seed=1, hold=hold, noisy=True), problem.model
    data.y[4, -1] = np.nan
    result = estimate(build(problem), model, data.recording(model))
    check_result(result)
    assert list(result["state"].values) == ["q", "v", "k"][: problem.nx]
    assert list(result["state_unit"].values) == ["length", "length", "1/s2"][: problem.nx]
    np.testing.assert_array_equal(np.isnan(result["e"].values), np.isnan(data.y))
    np.testing.assert_allclose(
        result["x_std"].values ** 2, np.einsum("kii->ki", result["P"].values), rtol=1e-14
    )
    np.testing.assert_array_equal(result["y_hat"].values, result["x_hat"].values[:, : problem.ny])
    assert result["status"].dtype == np.int32
    assert not result["status"].any()


def test_perfect_model_gives_zero_error(run, build, problem, hold):
    """Without noise, from the true start and with a wide prior, nothing is there to correct."""
    problem = dataclasses.replace(problem, k_known=True)
    data = problem.simulate(200, seed=2, hold=hold, noisy=False)
    prior = Prior(sigma_x0=problem.prior.sigma_x0, x0=data.x[0, :2])
    estimator = dataclasses.replace(build(problem), prior=prior)
    result = run(estimator.compile(problem.model, DT), data.arrays)
    assert_close(result["x_hat"], data.x[:, :2], 1e-13)
    assert np.abs(result["e"]).max() < 1e-13


def test_constant_parameter_is_recovered(run, recursion, problem, hold):
    only_with_parameter(problem)
    for seed in range(3):
        data = problem.simulate(600, seed=seed, hold=hold, noisy=True)
        result = run(recursion, data.arrays)
        error = result["x_hat"][-1, 2] - K_TRUE
        sigma = np.sqrt(result["P"][-1, 2, 2])
        assert sigma < 3.0
        assert abs(error) < 3 * sigma


def test_nis_is_in_its_band(run, recursion, problem, hold):
    """The sum of the NIS of all samples is chi-square with ny degrees of freedom per sample."""
    total, n = 0.0, 0
    for seed in range(10):
        result = run(recursion, problem.simulate(400, seed=seed, hold=hold, noisy=True).arrays)
        e, S = result["e"], result["S"]
        total += np.einsum("ki,ki", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])
        n += e.size
    low, high = chi2.ppf([0.005, 0.995], n)
    assert low < total < high


def test_errors_are_as_large_as_the_covariance_says(run, recursion, problem, hold):
    """The mean NEES over independent recordings; those of one recording are correlated."""
    values = []
    for seed in range(20):
        data = problem.simulate(120, seed=100 + seed, hold=hold, noisy=True)
        result = run(recursion, data.arrays)
        error = result["x_hat"][-1] - data.x[-1, : problem.nx]
        values.append(error @ np.linalg.solve(result["P"][-1], error))
    low, high = chi2.ppf([0.005, 0.995], problem.nx * len(values))
    assert low < sum(values) < high


def test_value_under_the_mask_has_no_influence(run, recursion, problem, hold):
    data = problem.simulate(60, seed=3, hold=hold, noisy=True)
    u, y, mask = data.arrays
    mask[7:12, 0] = mask[20] = mask[40:, -1] = 0.0
    other = np.where(mask == 1, y, 1e6)
    expected = run(recursion, [u, y, mask])
    for name, values in run(recursion, [u, other, mask]).items():
        np.testing.assert_array_equal(values, expected[name], err_msg=name)


def test_channel_never_measured_is_a_channel_deleted(build, problem, hold):
    if problem.ny < 2:
        pytest.skip("takes one output only")
    data = problem.simulate(80, seed=4, hold=hold, noisy=True)
    data.y[:, 1] = np.nan
    model = problem.model
    lacking = estimate(build(problem), model, data.recording(model))
    reduced = dataclasses.replace(model, outputs=model.outputs[:1], h=lambda x, u, p: [x.q])
    without = dataclasses.replace(
        build(problem), noise=Noise(R=problem.noise.R[:1, :1], sigma_w=problem.noise.sigma_w)
    )
    record = Data(data.u, data.x, data.y[:, :1]).recording(reduced)
    deleted = estimate(without, reduced, record)
    assert_close(lacking["x_hat"].values, deleted["x_hat"].values, 1e-11)
    assert_close(lacking["P"].values, deleted["P"].values, 1e-10)


def test_units_are_irrelevant(run, build, problem, hold):
    data = problem.simulate(100, seed=5, hold=hold, noisy=True)
    data.y[30:33, 0] = np.nan
    metres, inches = problem, dataclasses.replace(problem, length=1 / 0.0254)
    expected = run(build(metres).compile(metres.model, DT), data.arrays)
    result = run(build(inches).compile(inches.model, DT), data.scaled(length=inches.length).arrays)
    factors = inches.factors
    assert_close(result["x_hat"], factors * expected["x_hat"], 1e-10)
    assert_close(result["P"], np.outer(factors, factors) * expected["P"], 1e-9)
    assert_close(result["e"], inches.length * expected["e"], 1e-9)
    assert_close(result["S"], inches.length**2 * expected["S"], 1e-9)


def test_scales_are_irrelevant(run, build, problem, hold):
    arrays = problem.simulate(100, seed=6, hold=hold, noisy=True).arrays
    plain, odd = problem, dataclasses.replace(problem, scales={"q": 3e-4, "v": 20.0, "k": 7e3})
    expected = run(build(plain).compile(plain.model, DT), arrays)
    result = run(build(odd).compile(odd.model, DT), arrays)
    for name in ("x_hat", "P", "e", "S"):
        assert_close(result[name], expected[name], 1e-9)


def test_start_without_measurements_is_prediction(run, build, problem, hold):
    problem = dataclasses.replace(problem, k_known=True)
    data = problem.simulate(60, seed=7, hold=hold, noisy=True)
    start = data.x[0, :2] + [0.02, 0.0]
    prior = Prior(sigma_x0=problem.prior.sigma_x0, x0=start)
    recursion = dataclasses.replace(build(problem), prior=prior).compile(problem.model, DT)
    u, y, mask = data.arrays
    late, never = mask.copy(), np.zeros_like(mask)
    late[:9] = 0.0
    result, predicted = run(recursion, [u, y, late]), run(recursion, [u, y, never])
    x = np.array([*start, K_TRUE])
    for k in range(59):
        np.testing.assert_allclose(predicted["x_hat"][k], x[:2], rtol=1e-10, atol=1e-13)
        x = problem.step(x, u[k, 0], u[k + (hold == "foh"), 0])
    for name in ("x_hat", "P"):
        assert_close(result[name][:9], predicted[name][:9], 1e-14)
    np.testing.assert_allclose(result["x_hat"][-1], data.x[-1, :2], atol=5 * np.sqrt(R[1, 1]))
    assert np.all(np.diagonal(result["P"][-1]) < np.diagonal(predicted["P"][-1]) / 2)


def test_clipping_is_reported(run, build, problem, hold):
    only_with_parameter(problem)
    data = problem.simulate(150, seed=8, hold=hold, noisy=True)
    tight = dataclasses.replace(problem, k_bounds=(100.0, 130.0))
    result = run(build(tight).compile(tight.model, DT), data.arrays)
    k = result["x_hat"][:, 2]
    clipped = (result["status"].astype(int) & int(Status.CLIPPED)) != 0
    assert clipped.sum() > 20
    assert np.all(clipped[k > 130.0 * (1 - 1e-12)])
    assert 128.0 < k[-1] < k.max() * (1 + 1e-14) <= 130.0 * (1 + 1e-13)
    assert k.min() >= 100.0


def test_breakdown_names_the_sample(build, problem, hold):
    """A force of 1e200 at sample 30 is squared by the model: the state is infinite from there.

    Linear models multiply one of 1e308 by 1e4.
    """
    data = problem.simulate(50, seed=9, hold=hold, noisy=True)
    data.u[30] = 1e308 if problem.exact else 1e200

    def f(x, u, p):
        k = 120.0 if problem.k_known else x.k
        push = 1e4 * u.F if problem.exact else u.F**2
        return [x.v, -k * x.q - DT * x.v + push + p.push, 0.0][: problem.nx]

    model = dataclasses.replace(problem.model, f=f)
    with pytest.raises(EstimationError) as caught:
        estimate(build(problem), model, data.recording(model))
    result = caught.value.results
    finite = np.isfinite(result["x_hat"].values).all(axis=1)
    first = int(np.argmin(finite))
    assert first == (30 if hold == "foh" else 31)
    assert f"sample {first} (t = {first * DT:g} s)" in str(caught.value)
    failed = (result["status"].values & int(Status.NOT_FINITE)) != 0
    np.testing.assert_array_equal(failed, ~finite)
    silent = estimate(build(problem), model, data.recording(model), throw=False)
    np.testing.assert_array_equal(silent["x_hat"].values, result["x_hat"].values)


def only_with_parameter(problem: Problem) -> None:
    if problem.k_known:
        pytest.skip("estimates no parameter")
