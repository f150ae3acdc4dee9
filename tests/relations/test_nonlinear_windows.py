"""Windows of nonlinear models with sparse forces: what they must agree with."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.engine import native, vm
from estimators import struck
from run.test_nonlinear_sparse_forces import (
    DT,
    FORCES,
    HITS,
    KNOWING,
    METHOD,
    recording,
    score,
    structure,
)


def run(made, model, u, y, engine=vm, dt=DT):
    recursion = made.compile(model, dt)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = engine.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def bent_a_little(of):
    """The linear model with a term that vanishes, so that it is not seen as linear."""
    plant = struck.model(of)
    x, u, p = (plant.f.sx_in(i) for i in range(3))
    f = plant.f(x, u, p) + 1e-18 * x[0] ** 2
    return dataclasses.replace(plant, f=type(plant.f)("f", [x, u, p], [f]))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"lag": 2, "bias": "kept"},
        {"dictionary": bs.forces.HalfSines((1, 3))},
        {"arrival": bs.settings.SmoothedArrival(naive=True)},
        {"carryover": bs.forces.Carryover((2.0, 30.0)), "threshold": 0.5},
        {"limits": (bs.settings.Limit("a", {"a": 1.0}, upper=0.004),)},
        {"limits": (bs.settings.Limit("n", {"va": 1.0}, upper=4e-4, of="noise"),)},
        {"limits": (bs.settings.Limit("r", {"y": 1.0}, lower=-4e-4, of="residual"),)},
    ],
    ids=["plain", "lag", "pulses", "naive", "carryover", "state", "noise", "residual"],
)
@pytest.mark.parametrize("accelerations", [False, True])
def test_a_model_that_hardly_bends_is_the_linear_one(settings, accelerations):
    """Tables from the samples against those from the model; gaps, noise and known inputs."""
    of = struck.system(accelerations=accelerations)
    given = {"forces": FORCES, "lam": 0.6, "N": 4, "sigma_force": struck.SIGMA_FORCE, **settings}
    made = bs.CompressiveSensingMHE(**struck.gaussians(of), **given)
    u, y = struck.record(of, 12, seed=3, missing=0.15)
    linear = run(made, struck.model(of), u, y, dt=struck.DT)
    bent = run(made, bent_a_little(of), u, y, dt=struck.DT)
    for found in (linear, bent):  # atoms that nearly depend on each other: beyond all forces
        found["d_std"] = np.minimum(found["d_std"], 100.0)
    for name in ("x_hat", "P", "d_hat", "d_std", "y_hat", "e", "S", "nonzeros", "status"):
        size = np.abs(linear[name]).max()
        np.testing.assert_allclose(bent[name], linear[name], rtol=0, atol=1e-6 * size + 1e-12)


def test_one_window_of_all_is_the_search_over_the_recording():
    """Linearised until nothing moves, the last window is the l1 solution of the whole recording."""
    data = recording()[0].isel(time=slice(0, 14))
    made = dataclasses.replace(KNOWING, N=13, passes=8, lag=0, bias="kept")
    window = run(made, structure(joint=True), data["u"].values, data["y"].values)
    whole = bs.forces.find_sparse_forces(
        KNOWING, structure(joint=True), data, selection=bs.forces.L1(refit=False)
    )
    np.testing.assert_allclose(window["x_hat"][-1], whole["x_hat"].values[-1], rtol=1e-4, atol=1e-9)


def test_hits_are_found_window_by_window_where_a_linear_model_finds_others():
    data = recording()[0]
    made = dataclasses.replace(METHOD, threshold=1.0)
    assert score(bs.estimate(made, structure(0.0), data, engine="vm")) < 0.6
    assert score(bs.estimate(made, structure(), data, engine="vm")) >= 0.9


def test_a_parameter_is_found_together_with_the_hits():
    data = recording()[0]
    made = dataclasses.replace(KNOWING, threshold=1.0)
    found = bs.estimate(made, structure(joint=True), data, engine="vm")
    assert score(found) >= 0.9
    assert found["d_hat"].values[next(iter(HITS))] == pytest.approx(HITS[next(iter(HITS))], rel=0.1)
    k, std = (float(found[v].sel(state="k")[-1]) for v in ("x_hat", "x_std"))
    assert abs(k - 1) < min(0.2, 4 * std)


def test_engines_agree():
    data = recording()[0].isel(time=slice(0, 20))
    made = dataclasses.replace(KNOWING, N=4)
    model, rows = structure(joint=True), (data["u"].values, data["y"].values)
    slow, fast = (run(made, model, *rows, engine=e) for e in (vm, native))
    for name in ("x_hat", "P", "d_hat", "d_std", "e", "S"):
        np.testing.assert_allclose(fast[name], slow[name], rtol=1e-6, atol=1e-9)
