"""Joint input and state filter: exact without noise, the papers' filter, honest in gaps."""

import dataclasses

import numpy as np
import pytest
from forced_plants import ALL, DT, PLACES, cantilever, chain, plant
from scipy.stats import chi2

from backsight.discrete.exact import foh
from backsight.discrete.noise import discretise_noise
from backsight.engine import native, vm
from backsight.engine.recursion import Recursion
from backsight.errors import ModelError, TuningError
from backsight.estimators import JointInput, Noise, Prior
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.second_order import second_order
from backsight.schema import Status
from closeness import assert_close
from oracles.joint_input import with_feedthrough, without_feedthrough


def build(forces=ALL, *, noise=None, prior=None, sigma_force=None) -> JointInput:
    return JointInput(
        noise or Noise(sigma_y=1e-5),
        prior or Prior(sigma_x0=1e-6),
        forces=forces,
        sigma_force=sigma_force,
    )


def outputs_of(estimator: JointInput, model: Model, y, *, u=None, run=vm.run):
    u = np.zeros((len(y), model.nu)) if u is None else u
    return through(estimator.compile(model, DT), u, y, run)


def through(recursion: Recursion, u, y, run=vm.run):
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def sudden(n: int, m: int = 3) -> np.ndarray:
    """Nothing, then a hit, then a new force at every sample."""
    d = 5.0 * np.random.default_rng(0).standard_normal((n, m))
    d[:5] = 0.0
    d[5, 0] = -40.0
    return d


@pytest.mark.parametrize("make", [cantilever, chain])
@pytest.mark.parametrize(("kind", "delay"), [("displacement", 1), ("acceleration", 0)])
def test_as_many_sensors_as_forces_and_no_noise_give_every_force_exactly(make, kind, delay):
    """With few states and with many; what remains are rounding errors."""
    model, d = make(kind), sudden(60)
    x, y = plant(model).run(d)
    result = outputs_of(build(), model, y)
    assert_close(result["d_hat"][delay:], d[: len(d) - delay], 1e-7)
    assert_close(result["x_hat"], x, 1e-7)
    assert not result["status"].any()
    assert np.all(result["d_hat"][:delay] == 0)


@pytest.mark.parametrize("make", [cantilever, chain])
@pytest.mark.parametrize("kind", ["displacement", "acceleration"])
def test_it_is_the_filter_of_the_papers(make, kind):
    """More sensors than forces, correlated noise; one gain here, three steps there."""
    forces = ("F1", "F3")
    model, rng = make(kind), np.random.default_rng(3)
    p, n = plant(model, forces), model.nx // 2
    L = 1e-6 * np.tril(rng.standard_normal((3, 3))) + 1e-5 * np.eye(3)
    L *= 1e4 if kind == "acceleration" else 1.0
    Qc = np.diag([0.0] * n + [1e-4] * n)
    given = {"A": p.A, "G": p.E, "C": p.C, "R": L @ L.T, "x0": np.zeros(2 * n)}
    given["P0"] = np.diag([1e-8] * n + [1e-4] * n)
    given["Q"] = discretise_noise(state_space(model)[0], Qc, dt=DT)[1]
    _, y = p.run(sudden(50, 2), v=rng.standard_normal((50, 3)) @ L.T)
    if kind == "acceleration":
        x, P, found, P_d = with_feedthrough(y, D=p.F, **given)
    else:
        x, P, found, P_d = without_feedthrough(y, **given)
    estimator = build(forces, noise=Noise(R=given["R"], Qc=Qc), prior=Prior(P0=given["P0"]))
    start = kind == "displacement"
    for run in (vm.run, native.run):
        result = outputs_of(estimator, model, y, run=run)
        assert_close(result["x_hat"], x, 1e-8)
        assert_close(result["P"], P, 1e-7)
        assert_close(result["d_hat"][start:], found[start:], 1e-8)
        assert_close(result["P_d"][start:], P_d[start:], 1e-7)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_known_inputs_are_taken_out(hold):
    """Held or interpolated; the unknown forces are held in both cases."""
    model = cantilever("displacement", inputs=(0.2,))
    d, u = sudden(40), np.random.default_rng(1).standard_normal((41, 1))
    p, pushed = plant(model), np.zeros((40, 6))
    if hold == "foh":
        A, B, _, _ = state_space(model)
        _, first, second = foh(A, B, dt=DT)
        pushed = u[:-1] @ (first - p.B).T + u[1:] @ second.T
    _, y = p.run(d, u=u[:-1], w=pushed)
    estimator = dataclasses.replace(build(), hold=hold)
    assert_close(outputs_of(estimator, model, y, u=u[:-1])["d_hat"][1:], d[:-1], 1e-7)


def test_scales_of_the_forces_are_irrelevant():
    model = cantilever("acceleration")
    scaled = [dataclasses.replace(s, scale=7.0 + i) for i, s in enumerate(model.parameters)]
    d = sudden(20)
    _, y = plant(model).run(d)
    y[10] = np.nan
    expected, result = (
        outputs_of(build(sigma_force=9.0), m, y)
        for m in (model, dataclasses.replace(model, parameters=scaled))
    )
    for name in ("d_hat", "P_d", "x_hat", "y_hat"):
        assert_close(result[name], expected[name], 1e-9)


@pytest.mark.parametrize("kind", ["displacement", "acceleration"])
def test_covariances_are_those_of_the_errors(kind):
    """The NEES of the forces and of the states over many recordings, forces being anything."""
    forces = ("F1", "F3")
    model, sigma = cantilever(kind), 1e-5 if kind == "displacement" else 0.1
    p, n = plant(model, forces), 3
    w, x0, rng = 1e-5, 1e-3, np.random.default_rng(5)
    estimator = build(
        forces,
        noise=Noise(sigma_y=sigma, Q=np.diag([0.0] * n + [w**2] * n)),
        prior=Prior(sigma_x0=[x0 / 100] * n + [x0] * n),
    )
    # Process noise that drives the velocities between samples arrives through the motion.
    Q = discretise_noise(state_space(model)[0], np.diag([0] * n + [w**2 / DT] * n), dt=DT)[1]
    of_w, total, delay = np.linalg.cholesky(Q), np.zeros(2), kind == "displacement"
    runs, length, recursion = 60, 30, estimator.compile(model, DT)
    for _ in range(runs):
        d = 5.0 * rng.standard_normal((length, 2))
        start = rng.standard_normal(6) * ([x0 / 100] * n + [x0] * n)
        noise = rng.standard_normal((length, 6)) @ of_w.T, sigma * rng.standard_normal((length, 3))
        x, y = p.run(d, x0=start, w=noise[0], v=noise[1])
        result = through(recursion, np.zeros((length, 0)), y)
        errors = result["x_hat"][-1] - x[-1], result["d_hat"][-1] - d[-1 - delay]
        total += [
            error @ np.linalg.solve(result[of][-1], error)
            for error, of in zip(errors, ("P", "P_d"), strict=True)
        ]
    for value, size in zip(total, (6, 2), strict=True):
        low, high = chi2.ppf([0.001, 0.999], size * runs)
        assert low < value < high


def test_a_lost_channel_that_is_not_needed_is_left_out():
    """Two forces and one of three sensors missing: the papers' filter on the two rows."""
    forces = ("F1", "F3")
    model = cantilever("displacement")
    p = plant(model, forces)
    Q = np.diag([0.0] * 3 + [1e-10] * 3)
    _, y = p.run(sudden(40, 2), v=1e-5 * np.random.default_rng(2).standard_normal((40, 3)))
    y[10:20, 1] = np.nan
    given = {"R": 1e-10 * np.eye(3), "x0": np.zeros(6), "P0": 1e-8 * np.eye(6)}
    given["Q"] = discretise_noise(state_space(model)[0], Q / DT, dt=DT)[1]
    x, P, d, P_d = without_feedthrough(y, A=p.A, G=p.E, C=p.C, **given)
    noise = Noise(sigma_y=1e-5, Qc=Q / DT)
    result = outputs_of(build(forces, noise=noise, prior=Prior(P0=given["P0"])), model, y)
    assert not result["status"].any()
    for name, values in (("x_hat", x), ("P", P), ("d_hat", d), ("P_d", P_d)):
        assert_close(result[name][1:], values[1:], 1e-6)


@pytest.mark.parametrize("kind", ["displacement", "acceleration"])
def test_forces_that_cannot_be_seen_are_as_uncertain_as_is_said(kind):
    """Two forces, two sensors lost, then all: a status, and bands that hold."""
    forces = ("F1", "F3")
    model, sigma = cantilever(kind), 1e-5 if kind == "displacement" else 0.1
    d, spread = sudden(60, 2), 50.0
    x, y = plant(model, forces).run(d, v=sigma * np.random.default_rng(2).standard_normal((60, 3)))
    noise = Noise(sigma_y=sigma)
    y[20:23, 1:] = np.nan
    y[30] = np.nan
    result = outputs_of(build(forces, noise=noise, sigma_force=spread), model, y)
    lost = np.isnan(y).any(axis=1)
    np.testing.assert_array_equal(result["status"] == Status.UNOBSERVED, lost)
    np.testing.assert_allclose(result["d_hat"][30], 0.0, atol=1e-12)
    np.testing.assert_allclose(result["P_d"][30], spread**2 * np.eye(2), rtol=1e-9, atol=1e-9)
    delay = kind == "displacement"
    errors = result["d_hat"][delay:] - d[: len(d) - delay]
    sizes = np.sqrt(np.einsum("kii->ki", result["P_d"]))[delay:]
    assert np.all(np.abs(errors[10:]) < 5 * sizes[10:])
    assert np.all(np.abs(result["x_hat"] - x) < 5 * np.sqrt(np.einsum("kii->ki", result["P"])))


def test_without_a_size_a_force_that_was_not_seen_may_be_anything():
    model = cantilever("displacement")
    _, y = plant(model).run(sudden(40))
    y[20] = np.nan
    result = outputs_of(build(), model, y)
    assert np.sqrt(result["P_d"][20, 0, 0]) > 1e3 * np.sqrt(result["P_d"][19, 0, 0])


@pytest.mark.parametrize(
    ("kind", "sensors", "forces", "names", "message"),
    [
        ("displacement", PLACES, (0.2, *PLACES), (*ALL, "F4"), r"rank\(C B\) is at most 3; add"),
        ("displacement", (*PLACES, 0.2), (0.1, *PLACES), (*ALL, "F4"), "in 3 independent ways"),
        ("acceleration", (*PLACES, 0.2), (0.1, *PLACES), (*ALL, "F4"), r"rank\(D\) is 3 of 4"),
        ("displacement", (0.245,), PLACES, ("F3",), "would grow by the transmission zero"),
        ("displacement", PLACES, PLACES, ("F9",), "did you mean"),
        ("displacement", PLACES, PLACES, ("F1", "F1"), "'F1' is named twice"),
        ("displacement", PLACES, PLACES, (), "no unknown force is named"),
    ],
)
def test_what_cannot_work_is_said(kind, sensors, forces, names, message):
    model = cantilever(kind, sensors=sensors, forces=forces)
    with pytest.raises(TuningError, match=message):
        build(names).compile(model, DT)


def test_forces_that_only_some_sensors_contain_are_refused():
    row = {
        "coordinates": {"a": "m", "b": "m"},
        "forces": {"F1": "a", "F2": "b"},
        "parameters": {"F1": 0.0, "F2": 0.0},
        "outputs": {"y": ("acceleration", "a"), "z": ("displacement", "b")},
    }
    model = second_order(np.eye(2), np.eye(2), 100 * np.eye(2), **row)
    with pytest.raises(TuningError, match=r"directly, but not F2: rank\(D\) is 1 of 2"):
        build(("F1", "F2")).compile(model, DT)
    blind = row | {"outputs": {"y": ("displacement", "a"), "z": ("velocity", "a")}}
    model = second_order(np.eye(2), np.eye(2), 100 * np.eye(2), **blind)
    with pytest.raises(TuningError, match=r"F2 one sample later.*let the force walk"):
        build(("F1", "F2")).compile(model, DT)


def test_bad_sizes_and_too_slow_sampling_are_refused():
    model = cantilever("displacement")
    with pytest.raises(TuningError, match="must be positive and finite for F2"):
        build(sigma_force={"F1": 1.0, "F2": -1.0, "F3": 1.0}).compile(model, DT)
    with pytest.raises(TuningError, match="must be positive and finite for F2, F3"):
        build(sigma_force={"F1": 1.0}).compile(model, DT)
    with pytest.raises(ModelError, match=r"153\.\d Hz \(q3, q3_dot\); the limit"):
        build().compile(model, 1 / 250)
