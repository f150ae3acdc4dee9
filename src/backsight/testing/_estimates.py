"""What a user may rely on: honest estimates, whatever the units, gaps and bounds."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from backsight.errors import DataError, EstimationError
from backsight.estimators.uncertainty import Noise, Prior
from backsight.run.estimation import estimate
from backsight.schema import Status, check_result
from backsight.testing.case import Subject
from backsight.testing.close import ContractError, assert_close, assert_same, require
from backsight.testing.problem import DT, K_TRUE, Data, R, TrialProblem


def result_has_the_schema(on: Subject) -> None:
    """A result has every variable, with names and units, and a status without complaints."""
    problem = on.problem
    data, model = problem.simulate(20, seed=1, hold=on.hold, noisy=True), problem.model
    data.y[4, -1] = np.nan
    result = estimate(on.build(problem), model, data.recording(model))
    try:
        check_result(result)
    except DataError as error:
        raise ContractError(str(error)) from None
    names, units = ["q", "v", "k"][: problem.nx], ["length", "length", "1/s2"][: problem.nx]
    require(list(result["state"].values) == names, f"the states are not {names}")
    require(list(result["state_unit"].values) == units, f"the units are not {units}")
    missing = np.isnan(data.y)
    assert_same(np.isnan(result["e"].values), missing, "'e is NaN where y is'")
    variance = np.einsum("kii->ki", result["P"].values)
    assert_close(result["x_std"].values ** 2, variance, 1e-14, "x_std squared")
    assert_same(result["y_hat"].values, result["x_hat"].values[:, : problem.ny], "y_hat")
    require(result["status"].dtype == np.int32, "status is not of the kind int32")
    require(not result["status"].any(), f"status is {result['status'].values.tolist()}, not 0")


def perfect_model_gives_zero_error(on: Subject) -> None:
    """Without noise, from the true start and with a wide prior, nothing is there to correct."""
    problem = dataclasses.replace(on.problem, k_known=True)
    data = problem.simulate(200, seed=2, hold=on.hold, noisy=False)
    prior = Prior(sigma_x0=problem.prior.sigma_x0, x0=data.x[0, :2])
    estimator = dataclasses.replace(on.build(problem), prior=prior)  # type: ignore[call-arg]
    result = on.run(estimator.compile(problem.model, DT), data.arrays)
    assert_close(result["x_hat"], data.x[:, :2], 1e-13, "x_hat")
    require(np.abs(result["e"]).max() < 1e-13, f"e is {np.abs(result['e']).max():.2e}, not 0")


def constant_parameter_is_recovered(on: Subject) -> None:
    """A constant parameter is found, within three of its standard deviations."""
    recursion = on.recursion()
    for seed in range(on.amount(3)):
        data = on.problem.simulate(600, seed=seed, hold=on.hold, noisy=True)
        result = on.run(recursion, data.arrays)
        error = result["x_hat"][-1, 2] - K_TRUE
        sigma = np.sqrt(result["P"][-1, 2, 2])
        require(sigma < 3.0, f"after 600 samples sigma of k is {sigma:.3g}, not below 3")
        require(abs(error) < 3 * sigma, f"k is off by {error:.3g}, sigma is {sigma:.3g}")


def nis_is_in_its_band(on: Subject) -> None:
    """The sum of the NIS of all samples is chi-square with ny degrees of freedom per sample."""
    recursion, total, n = on.recursion(), 0.0, 0
    for seed in range(on.amount(10)):
        data = on.problem.simulate(400, seed=seed, hold=on.hold, noisy=True)
        result = on.run(recursion, data.arrays)
        e, S = result["e"], result["S"]
        total += np.einsum("ki,ki", e, np.linalg.solve(S, e[:, :, None])[:, :, 0])
        n += e.size
    _inside(total, n, "NIS")


def errors_are_as_large_as_the_covariance_says(on: Subject) -> None:
    """The mean NEES over independent recordings; those of one recording are correlated."""
    recursion, problem, values = on.recursion(), on.problem, []
    for seed in range(on.amount(20)):
        data = problem.simulate(120, seed=100 + seed, hold=on.hold, noisy=True)
        result = on.run(recursion, data.arrays)
        error = result["x_hat"][-1] - data.x[-1, : problem.nx]
        values.append(error @ np.linalg.solve(result["P"][-1], error))
    _inside(sum(values), problem.nx * len(values), "NEES")


def _inside(total: float, n: int, what: str) -> None:
    low, high = scipy.stats.chi2.ppf([0.005, 0.995], n)
    require(
        low < total < high, f"the sum of the {what} is {total:.1f}, not {low:.1f} to {high:.1f}"
    )


def value_under_the_mask_has_no_influence(on: Subject) -> None:
    """What stands where nothing was measured is never used."""
    data, recursion = on.problem.simulate(60, seed=3, hold=on.hold, noisy=True), on.recursion()
    u, y, mask = data.arrays
    mask[7:12, 0] = mask[20] = mask[40:, -1] = 0.0
    other = np.where(mask == 1, y, 1e6)
    expected = on.run(recursion, [u, y, mask])
    for name, values in on.run(recursion, [u, other, mask]).items():
        assert_same(values, expected[name], name)


def channel_never_measured_is_a_channel_deleted(on: Subject) -> None:
    """An output that is never measured might as well not be in the model."""
    problem = on.problem
    data = problem.simulate(80, seed=4, hold=on.hold, noisy=True)
    data.y[:, 1] = np.nan
    model = problem.model
    lacking = estimate(on.build(problem), model, data.recording(model))
    reduced = dataclasses.replace(model, outputs=model.outputs[:1], h=lambda x, *_: [x.q])
    noise = Noise(R=problem.noise.R[:1, :1], sigma_w=problem.noise.sigma_w)  # type: ignore[index]
    without = dataclasses.replace(on.build(problem), noise=noise)  # type: ignore[call-arg]
    record = Data(data.u, data.x, data.y[:, :1]).recording(reduced)
    deleted = estimate(without, reduced, record)
    assert_close(lacking["x_hat"].values, deleted["x_hat"].values, 1e-11, "x_hat")
    assert_close(lacking["P"].values, deleted["P"].values, 1e-10, "P")


def units_are_irrelevant(on: Subject) -> None:
    """In inches everything is what it is in metres."""
    data = on.problem.simulate(100, seed=5, hold=on.hold, noisy=True)
    data.y[30:33, 0] = np.nan
    inches = dataclasses.replace(on.problem, length=1 / 0.0254)
    expected = on.run(on.recursion(), data.arrays)
    scaled = data.scaled(length=inches.length)
    result = on.run(on.build(inches).compile(inches.model, DT), scaled.arrays)
    factors = inches.factors
    assert_close(result["x_hat"], factors * expected["x_hat"], 1e-10, "x_hat")
    assert_close(result["P"], np.outer(factors, factors) * expected["P"], 1e-9, "P")
    assert_close(result["e"], inches.length * expected["e"], 1e-9, "e")
    assert_close(result["S"], inches.length**2 * expected["S"], 1e-9, "S")


def scales_are_irrelevant(on: Subject) -> None:
    """`Signal.scale` is for rounding only."""
    arrays = on.problem.simulate(100, seed=6, hold=on.hold, noisy=True).arrays
    odd = dataclasses.replace(on.problem, scales={"q": 3e-4, "v": 20.0, "k": 7e3})
    expected = on.run(on.recursion(), arrays)
    result = on.run(on.build(odd).compile(odd.model, DT), arrays)
    for name in ("x_hat", "P", "e", "S"):
        assert_close(result[name], expected[name], 1e-9, name)


def start_without_measurements_is_prediction(on: Subject) -> None:
    """Before the first measurement the estimate is what the model says, with a growing band."""
    problem = dataclasses.replace(on.problem, k_known=True)
    data = problem.simulate(60, seed=7, hold=on.hold, noisy=True)
    start = data.x[0, :2] + [0.02, 0.0]
    prior = Prior(sigma_x0=problem.prior.sigma_x0, x0=start)
    estimator = dataclasses.replace(on.build(problem), prior=prior)  # type: ignore[call-arg]
    recursion = estimator.compile(problem.model, DT)
    u, y, mask = data.arrays
    late, never = mask.copy(), np.zeros_like(mask)
    late[:9] = 0.0
    result, predicted = on.run(recursion, [u, y, late]), on.run(recursion, [u, y, never])
    x, path = np.array([*start, K_TRUE]), []
    for k in range(59):
        path.append(x[:2])
        x = problem.step(x, u[k, 0], u[k + (on.hold == "foh"), 0])
    off = np.abs(predicted["x_hat"][:59] - np.array(path)) - 1e-10 * np.abs(np.array(path))
    require(np.all(off <= 1e-13), f"the prediction is off by {off.max():.2e}")
    for name in ("x_hat", "P"):
        assert_close(result[name][:9], predicted[name][:9], 1e-14, name)
    off = np.abs(result["x_hat"][-1] - data.x[-1, :2])
    require(np.all(off <= 5 * np.sqrt(R[1, 1])), f"after the measurements x_hat is off by {off}")
    now, without = (np.diagonal(r["P"][-1]) for r in (result, predicted))
    require(np.all(now < without / 2), "measurements do not halve the variance")


def clipping_is_reported(on: Subject) -> None:
    """A state stays within its bounds, and the samples in which it was held there say so."""
    data = on.problem.simulate(150, seed=8, hold=on.hold, noisy=True)
    tight = dataclasses.replace(on.problem, k_bounds=(100.0, 130.0))
    result = on.run(on.build(tight).compile(tight.model, DT), data.arrays)
    k = result["x_hat"][:, 2]
    clipped = (result["status"].astype(int) & int(Status.CLIPPED)) != 0
    require(clipped.sum() > 20, f"only {clipped.sum()} samples say that they were clipped")
    require(np.all(clipped[k > 130.0 * (1 - 1e-12)]), "a sample at the bound does not say so")
    inside = 128.0 < k[-1] < k.max() * (1 + 1e-14) <= 130.0 * (1 + 1e-13)
    require(inside, f"the parameter ends at {k[-1]} and reaches {k.max()}; its bound is 130")
    require(k.min() >= 100.0, f"the parameter falls to {k.min()}; its bound is 100")


def breakdown_names_the_sample(on: Subject) -> None:
    """A force of 1e200 at sample 30 is squared by the model: the state is infinite from there.

    Linear models multiply one of 1e308 by 1e4.
    """
    problem = on.problem
    data = problem.simulate(50, seed=9, hold=on.hold, noisy=True)
    data.u[30] = 1e308 if problem.exact else 1e200
    model = dataclasses.replace(problem.model, f=_overflowing(problem))
    try:
        estimate(on.build(problem), model, data.recording(model))
    except EstimationError as caught:
        error = caught
    else:
        raise ContractError("an infinite state raises no EstimationError")
    result = error.results
    finite = np.isfinite(result["x_hat"].values).all(axis=1)  # type: ignore[index]
    first = int(np.argmin(finite))
    expected = 30 if on.hold == "foh" else 31
    require(first == expected, f"x_hat is not finite from sample {first}, not {expected}")
    told = f"sample {first} (t = {first * DT:g} s)"
    require(told in str(error), f"the message does not name {told}: {error}")
    failed = (result["status"].values & int(Status.NOT_FINITE)) != 0  # type: ignore[index]
    assert_same(failed, ~finite, "'status says that x_hat is not finite'")
    silent = estimate(on.build(problem), model, data.recording(model), throw=False)
    assert_same(silent["x_hat"].values, result["x_hat"].values, "x_hat")  # type: ignore[index]


def _overflowing(problem: TrialProblem) -> Callable[[Any, Any, Any], list[Any]]:
    def f(x: Any, u: Any, p: Any) -> list[Any]:
        k = 120.0 if problem.k_known else x.k
        push = 1e4 * u.F if problem.exact else u.F**2
        return [x.v, -k * x.q - DT * x.v + push + p.push, 0.0][: problem.nx]

    return f
