"""Sparse forces from a whole recording against the problem written down in full."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight import schema
from backsight.errors import DataError, TuningError
from backsight.estimators.dictionaries import HalfSines
from backsight.run.sparse_forces import prepared
from backsight.sparse import _force_search as force_search
from estimators import struck
from oracles import struck_beam
from oracles.sparse_forces import root, solve

SAMPLES = 14


def estimator(of, **settings):
    given = {"forces": struck.FORCES, "lam": 0.6, "sigma_force": struck.SIGMA_FORCE}
    return bs.CompressiveSensingMHE(**struck.gaussians(of), **(given | settings))


def recording(u, y):
    return schema.recording(
        np.arange(len(u)) * struck.DT, u=u, y=y, inputs={"f": "N"},
        outputs={"y": "m", "z": "m"}, dt=struck.DT,
    )  # fmt: skip


def beam_recording(sigma: float, seed: int = 0):
    noise = sigma * np.random.default_rng(seed).standard_normal((struck_beam.SAMPLES, 3))
    return schema.recording(
        np.arange(struck_beam.SAMPLES) * struck_beam.DT,
        u=np.zeros((struck_beam.SAMPLES, 0)), y=struck_beam.measured() + noise,
        inputs={}, outputs=dict.fromkeys(("s1", "s2", "s3"), "m"), dt=struck_beam.DT,
    )  # fmt: skip


def beam_estimator(thickness: float = 0.003, lam: float = 15.0):
    made = struck_beam.estimator(thickness, eps_Q=0.0739, eps_R=1e-10, lam=lam)
    return dataclasses.replace(made, threshold=0.0)


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("case", ["impulses", "pulses", "known sign"])
def test_the_l1_solution_is_exact(case, accelerations):
    """States, covariances, forces; with gaps, known inputs, forces inside the outputs."""
    settings = {
        "impulses": {},
        "pulses": {"dictionary": HalfSines((1, 3)), "lam": 1.0},
        "known sign": {"nonnegative": struck.FORCES},
    }[case]
    of = struck.system(accelerations=accelerations)
    made = estimator(of, **settings)
    u, y = struck.record(of, SAMPLES, seed=3, missing=0.15)
    expected = solve(
        of, y, u, x0=struck.X0, P0=struck.P0, shapes=made.dictionary.shapes(4), lam=made.lam,
        tail=np.zeros((SAMPLES, 4)), sign=1 if made.nonnegative else 0,
    )  # fmt: skip
    found = bs.forces.find_sparse_forces(
        made, struck.model(of), recording(u, y), selection=bs.forces.L1(refit=False)
    )
    assert found.attrs["nonzeros"] == np.count_nonzero(expected.alpha) > 2
    np.testing.assert_allclose(found["d_hat"], expected.forces, atol=1e-7)
    np.testing.assert_allclose(found["x_hat"], expected.x[:SAMPLES], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found["P"], expected.P[:SAMPLES], rtol=1e-6, atol=1e-11)
    if case != "pulses":
        std = np.sqrt(np.diag(expected.covariance)).reshape(expected.alpha.shape)
        np.testing.assert_allclose(found["d_std"][: len(std)], std, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_without_forces_it_is_the_kalman_filter(hold):
    """The same innovations, and the same state at the last sample, where smoothing ends."""
    model = bs.beam(
        0.4, width=0.02, thickness=0.003, youngs_modulus=70e9, density=2700.0, modes=2,
        sensors={"y": ("displacement", 0.4), "a": ("acceleration", 0.2)},
        forces={"F": 0.3}, inputs={"f": 0.2},
    )  # fmt: skip
    rng, n = np.random.default_rng(0), 50
    y = rng.standard_normal((n, 2)) * [1e-4, 1.0]
    y[rng.random((n, 2)) < 0.2] = np.nan
    given = schema.recording(
        np.arange(n) / 500, u=rng.standard_normal((n, 1)), y=y, inputs={"f": "N"},
        outputs={"y": "m", "a": "m/s2"}, dt=1 / 500,
    )  # fmt: skip
    known = {
        "noise": bs.Noise(sigma_y={"y": 1e-4, "a": 0.5}, sigma_w=1e-3),
        "prior": bs.Prior(sigma_x0=1e-2),
        "hold": hold,
    }
    made = bs.CompressiveSensingMHE(forces=("F",), lam=1.0, **known)
    whole = bs.forces.find_sparse_forces(
        made, model, given, selection=bs.forces.Greedy(penalty=1e9)
    )
    filtered = bs.estimate(bs.KalmanFilter(**known), model, given)
    assert whole.attrs["nonzeros"] == 0
    np.testing.assert_allclose(whole["e"], filtered["e"], rtol=1e-7, atol=1e-10)
    for name in ("x_hat", "P", "y_hat"):
        last = filtered[name][-1]
        np.testing.assert_allclose(whole[name][-1], last, rtol=1e-7, atol=1e-12)
    assert (whole["x_std"] <= filtered["x_std"] * (1 + 1e-9)).all()


def test_innovations_and_responses_are_white():
    """The cost of any forces is that of the joint normal distribution of all outputs."""
    of = struck.system(accelerations=True)
    n, rng = 6, np.random.default_rng(0)
    u, y = struck.record(of, n, seed=1)
    search = prepared(estimator(of), struck.model(of), recording(u, y))
    noise = of.noise

    def outputs(x, d, w, v):
        rows = []
        for k in range(n):
            rows.append(of.C @ x + of.F @ d[k] + noise[4:] @ w[k] + v[k])
            x = of.A @ x + of.E @ d[k] + noise[:4] @ w[k]
        return np.array(rows).ravel()

    q = noise.shape[1]
    zero = {"x": np.zeros(4), "d": np.zeros((n, 4)), "w": np.zeros((n, q)), "v": np.zeros((n, 2))}

    def effects(of_what, shape):
        return np.array(
            [
                outputs(**(zero | {of_what: unit.reshape(shape)}))
                for unit in np.eye(int(np.prod(shape)))
            ]
        ).T

    parts = [
        effects("x", (4,)) @ root(struck.P0),
        effects("w", (n, q)),
        effects("v", (n, 2)) @ np.kron(np.eye(n), root(of.R)),
    ]
    V = sum(part @ part.T for part in parts)
    known = []
    x = struck.X0
    for k in range(n):
        known.append(of.C @ x + of.D @ u[k])
        x = of.A @ x + of.B @ u[k]
    for _ in range(3):
        d = rng.standard_normal((n, 4))
        r = y.ravel() - np.ravel(known) - outputs(**(zero | {"d": d}))
        e = search.filter.innovations(d)
        assert (e**2).sum() == pytest.approx(r @ np.linalg.solve(V, r))
        columns = np.zeros(len(search.step))
        columns[:] = d[search.step, search.atom]
        moved = search.regression.target - search.regression.columns @ columns
        np.testing.assert_allclose(moved, e.ravel(), atol=1e-9)


def test_the_hits_on_the_beam_are_found():
    """At three sensors out of eight places and 60 moments, within their standard deviations."""
    made, model, given = beam_estimator(), struck_beam.model(0.003), beam_recording(1e-5)
    true = struck_beam.forces()
    found = bs.forces.find_sparse_forces(made, model, given)
    d, std = found["d_hat"].values, found["d_std"].values
    at = true != 0
    assert bs.forces.compare_forces(d, true).exact
    assert (np.abs(d - true)[at] < 4 * std[at]).all()
    assert std[at].max() < 1
    assert not found["status"].any()
    schema.check_result(found)
    quiet = beam_recording(0.0)
    for selection in (bs.forces.L1(), bs.forces.Reweighted(), bs.forces.Greedy()):
        exact = bs.forces.find_sparse_forces(
            beam_estimator(lam=0.1), model, quiet, selection=selection
        )
        np.testing.assert_allclose(exact["d_hat"], true, atol=1e-8)


def test_another_estimators_hits_lose_their_bias():
    made, model, given = beam_estimator(lam=0.1), struck_beam.model(0.003), beam_recording(0.0)
    biased = bs.forces.find_sparse_forces(made, model, given, selection=bs.forces.L1(refit=False))
    free = bs.forces.find_sparse_forces(
        made, model, given, selection=bs.forces.Given(biased["d_hat"])
    )
    again = bs.forces.find_sparse_forces(made, model, given, selection=bs.forces.L1())
    np.testing.assert_allclose(free["d_hat"], again["d_hat"], atol=1e-9)
    true = struck_beam.forces()
    at = true != 0
    error = [np.abs(r["d_hat"].values - true)[at].sum() for r in (biased, free)]
    assert error[1] < 1e-6 < 1e-2 < error[0]
    assert free.attrs["chi2"] < biased.attrs["chi2"]


def test_forces_below_the_threshold_are_dropped():
    made = dataclasses.replace(beam_estimator(lam=3.0), threshold=2.0)
    found = bs.forces.find_sparse_forces(
        made, struck_beam.model(0.003), beam_recording(1e-5), selection=bs.forces.L1(refit=False)
    )
    d = found["d_hat"].values
    assert 0 < found.attrs["nonzeros"] == np.count_nonzero(d)
    assert np.abs(d[d != 0]).min() >= 2.0


def test_nothing_is_found_in_nothing():
    rest = beam_recording(0.0) * 0.0
    rest.attrs = beam_recording(0.0).attrs
    found = bs.forces.find_sparse_forces(beam_estimator(), struck_beam.model(0.003), rest)
    assert found.attrs["nonzeros"] == 0
    assert not found["d_hat"].any()
    assert not found["x_hat"].any()


def test_bad_input_is_refused(monkeypatch):
    made, model, given = beam_estimator(), struck_beam.model(0.003), beam_recording(1e-5)
    with pytest.raises(DataError, match=r"shape \(3, 3\).*\(61, 8\)"):
        bs.forces.find_sparse_forces(made, model, given, selection=bs.forces.Given(np.eye(3)))
    pulses = dataclasses.replace(made, dictionary=HalfSines((2,)))
    with pytest.raises(TuningError, match="Impulses"):
        bs.forces.find_sparse_forces(
            pulses, model, given, selection=bs.forces.Given(struck_beam.forces())
        )
    for selection, match in (
        (lambda: bs.forces.Greedy(penalty=-1), "penalty is -1"),
        (lambda: bs.forces.Reweighted(iterations=0), "iterations is 0"),
        (lambda: bs.forces.Reweighted(floor=0), "floor is 0"),
    ):
        with pytest.raises(TuningError, match=match):
            selection()
    monkeypatch.setattr(force_search, "ROOM", 0.0)
    with pytest.raises(DataError, match="GB of memory"):
        bs.forces.find_sparse_forces(made, model, given)
