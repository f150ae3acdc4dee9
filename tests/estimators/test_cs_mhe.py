"""The compressive-sensing MHE against the problem that it solves, written down in full."""

import dataclasses
import math

import numpy as np
import pytest

import backsight as bs
from backsight import schema
from backsight.engine import native, vm
from backsight.errors import ModelError, TuningError
from backsight.estimators.arrival import arrival_name
from backsight.forces import Atoms, Carryover, ForceLine, HalfSines, MovingLoads
from backsight.run.compare import compare
from backsight.settings import ConstantArrival, EKFArrival, NoArrival, SmoothedArrival
from closeness import assert_close
from estimators import struck
from oracles import struck_beam
from oracles.algorithm_1 import Setup, windows

N, SAMPLES, LAM = 4, 13, 0.6


def run(made, model, u, y, engine=vm):
    recursion = made.compile(model, struck.DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = engine.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def estimator(of, **settings):
    given = {"forces": struck.FORCES, "lam": LAM, "N": N, "sigma_force": struck.SIGMA_FORCE}
    return bs.CompressiveSensingMHE(**struck.gaussians(of), **({"bias": "kept"} | given | settings))


def setup(made: bs.CompressiveSensingMHE) -> Setup:
    carry = made.carryover
    return Setup(
        lam=made.lam,
        N=made.N,
        shapes=made.dictionary.shapes(len(made.forces)),
        x0=struck.X0,
        P0=struck.P0,
        arrival=arrival_name(made.arrival),
        threshold=made.threshold,
        sign=1 if made.nonnegative else -1 if made.nonpositive else 0,
        **({} if carry is None else dataclasses.asdict(carry)),
    )


def recording(u, y):
    return schema.recording(
        np.arange(len(u)) * struck.DT, u=u, y=y, inputs={"f": "N"},
        outputs={"y": "m", "z": "m"}, dt=struck.DT,
    )  # fmt: skip


CASES = {
    "smoothed": {},
    "naive": {"arrival": SmoothedArrival(naive=True)},
    "constant": {"arrival": ConstantArrival()},
    "known sign": {"nonnegative": struck.FORCES},
    "other sign": {"nonpositive": struck.FORCES},
    "pulses": {"dictionary": HalfSines((1, 3)), "lam": 1.0},
    "moving": {"dictionary": MovingLoads(ForceLine((1, 2, 3, 4)), (3, -2)), "lam": 1.0},
    "groups": {"dictionary": Atoms(np.array([[1.0, 0], [1, 0], [0, 1], [0, 2]]))},
    "separate": {"carryover": Carryover((2.0, 30.0)), "threshold": 0.5},
    "prior": {"carryover": Carryover((0.1, 4.0), "prior"), "arrival": SmoothedArrival(naive=True)},
    "release": {"carryover": Carryover((0.5, 5.0), "release", age=3), "threshold": 0.2},
}


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("case", list(CASES))
def test_every_window_is_solved_exactly(case, accelerations):
    """Also while the window fills, with gaps, known inputs, and forces inside the outputs."""
    of = struck.system(accelerations=accelerations)
    model, made = struck.model(of), estimator(of, **CASES[case])
    u, y = struck.record(of, SAMPLES, seed=3, missing=0.15)
    expected = windows(of, setup(made), y, u)
    assert any(np.abs(w.alpha).max(initial=0) > 1 for _, w in expected)
    for lag in (0, 2, N) if case == "smoothed" else (1,):
        found = run(dataclasses.replace(made, lag=lag), model, u, y)
        assert not found["status"].any()
        assert found["kkt"].max() < 1e-8
        for k, (start, w) in enumerate(expected):
            at = max(k - lag - start, 0)
            np.testing.assert_allclose(found["x_hat"][k], w.x[at], rtol=1e-6, atol=1e-8)
            np.testing.assert_allclose(found["P"][k], w.P[at], rtol=1e-6, atol=1e-11)
            np.testing.assert_allclose(found["d_raw"][k], w.forces[at], rtol=1e-6, atol=1e-6)
            assert found["nonzeros"][k] == np.count_nonzero(w.alpha)
            if made.dictionary.shapes(4).shape[1:] == (1, 4):
                variance = np.diag(w.covariance).reshape(w.alpha.shape)
                stds = np.sqrt(variance[at]) if at < len(variance) else np.zeros(4)
                np.testing.assert_allclose(found["d_std"][k], stds, rtol=1e-5, atol=1e-7)


def test_threshold_and_corrections():
    """What is below the threshold is left out and, if asked for, spread over the rest."""
    of = struck.system()
    u, y = struck.record(of, SAMPLES, seed=3)
    made = estimator(of, lam=0.05, lag=2)
    limit = 2.0
    expected = [w for _, w in windows(of, setup(made), y, u)]
    for rule in ("none", "amplitude", "energy"):
        found = run(
            dataclasses.replace(made, threshold=limit, correction=rule), struck.model(of), u, y
        )
        for k in range(N, SAMPLES):
            alpha = np.abs(expected[k].alpha)
            power = 2 if rule == "energy" else 1
            kept, lost = (np.sum(alpha[m] ** power) for m in (alpha >= limit, alpha < limit))
            factor = 1.0 if rule == "none" or kept == 0 else (1 + lost / kept) ** (1 / power)
            raw = found["d_raw"][k]
            chosen = np.where(np.abs(raw) >= limit, factor * raw, 0)
            np.testing.assert_allclose(found["d_hat"][k], chosen, rtol=1e-6)


@pytest.mark.parametrize("lag", [0, 3])
def test_rows_are_about_their_sample(lag):
    """The same windows whatever the lag; the last rows come from a window that runs on."""
    of = struck.system()
    u, y = struck.record(of, 20, seed=1)
    model, made = struck.model(of), estimator(of, lag=lag)
    result = bs.estimate(made, model, recording(u, y))
    raw = run(made, model, u, y)
    n = 20 - lag
    for name in ("x_hat", "P", "d_raw", "status"):
        np.testing.assert_array_equal(result[name].values[:n], raw[name][lag:])
    newest = bs.estimate(dataclasses.replace(made, lag=0, lam=math.inf), model, recording(u, y))
    late = bs.estimate(dataclasses.replace(made, lam=math.inf), model, recording(u, y))
    assert_close(late["e"].values, newest["e"].values, 1e-9)
    assert_close(late["S"].values, newest["S"].values, 1e-9)


def test_engines_agree_and_many_are_one():
    of = struck.system()
    model, made = struck.model(of), estimator(of, carryover=Carryover((1.0, 9.0)), lam=0.3)
    records = [struck.record(of, 40 + 5 * k, seed=k, missing=0.1) for k in range(3)]
    slow = [bs.estimate(made, model, recording(*r), engine="vm") for r in records]
    fast = [bs.estimate(made, model, recording(*r), engine="native") for r in records]
    many = bs.estimate_many(made, model, [recording(*r) for r in records])
    for name in ("x_hat", "P", "d_hat", "d_std", "e", "S"):
        for a, b, c in zip(slow, fast, many, strict=True):
            np.testing.assert_allclose(b[name].values, a[name].values, rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(c[name].values, a[name].values, rtol=1e-6, atol=1e-9)


def test_lambda_max():
    """Above it nothing is found, and that is said; just below it something is."""
    of = struck.system()
    u, y = struck.record(of, 30, seed=2)
    model, made = struck.model(of), estimator(of)
    most = bs.tune.lambda_max(made, model, recording(u, y))
    above = dataclasses.replace(made, lam=1.001 * most)
    below = dataclasses.replace(made, lam=0.98 * most)
    nothing = bs.estimate(above, model, recording(u, y))
    assert not nothing["d_raw"].values.any()
    assert "lambda_max" in nothing.attrs["remarks"]
    assert f"{most:.4g}" in nothing.attrs["remarks"]
    sentences = compare({"CS": above}, model, recording(u, y)).verdicts()
    assert "no force was found" in sentences[-1]
    found = bs.estimate(below, model, recording(u, y))
    assert found["d_raw"].values.any()
    assert "remarks" not in found.attrs


@pytest.mark.parametrize(
    ("settings", "remark"),
    [({"threshold": 1e6}, "are below the threshold"), ({"lag": 0}, "raise lag")],
)
def test_forces_that_are_found_but_not_shown(settings, remark):
    of = struck.system()
    u, y = struck.record(of, 30, seed=2)
    result = bs.estimate(estimator(of, **settings), struck.model(of), recording(u, y))
    assert remark in result.attrs["remarks"]


def test_known_at_rest_and_dependent_places():
    """A prior without variance is allowed; places that act alike need no more than one force."""
    of = struck.system()
    twins = dataclasses.replace(of, E=of.E[:, [0, 0, 2, 3]], F=of.F[:, [0, 0, 2, 3]])
    u, y = struck.record(twins, 30, seed=4)
    made = dataclasses.replace(estimator(twins, lam=0.05), prior=bs.Prior(P0=np.zeros((4, 4))))
    found = run(made, struck.model(twins), u, y)
    assert found["kkt"].max() < 1e-8
    assert not (found["status"].astype(int) & ~int(schema.Status.DEPENDENT)).any()
    assert not np.any((found["d_raw"][:, 0] != 0) & (found["d_raw"][:, 1] != 0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"N": 0}, "horizon N is 0"),
        ({"lag": 5}, "lag is 5"),
        ({"lam": 0.0}, "lam is 0.0; it must be positive"),
        ({"lam": math.nan}, "lam is nan"),
        ({"threshold": -1.0}, "threshold is -1.0"),
        ({"arrival": EKFArrival()}, "the arrival cost is .*; it must be a SmoothedArrival"),
        ({"arrival": NoArrival(width=10.0)}, "does not need: the first state is free"),
        ({"lag": None}, "the lag is None; it must be"),
        ({"correction": "energie"}, "did you mean 'energy'"),
    ],
)
def test_refused_at_once(settings, message):
    with pytest.raises(TuningError, match=message):
        estimator(struck.system(), **settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"forces": ("F1", "F5")}, "no parameter 'F5'"),
        ({"forces": ()}, "no unknown force"),
        ({"sigma_force": {"F9": 1.0}}, "sigma_force names 'F9'"),
        ({"sigma_force": -1.0}, "must not be negative"),
        ({"dictionary": Atoms(np.eye(3))}, "has 3 rows; 4 forces need 4"),
        ({"dictionary": HalfSines((9,))}, "atoms of 9 steps; the window of N = 4 is too short"),
        ({"nonnegative": ("F7",)}, "'F7' is none of the forces"),
        ({"nonnegative": ("F1",), "nonpositive": ("F1",)}, "'F1' is nonnegative and nonpositive"),
        (
            {"nonnegative": ("F1",), "dictionary": Atoms(np.ones((4, 1)))},
            "whose atoms are of one force",
        ),
    ],
)
def test_refused_for_the_model(settings, message):
    of = struck.system()
    with pytest.raises(TuningError, match=message):
        estimator(of, **settings).compile(struck.model(of), struck.DT)


@pytest.mark.parametrize("matrix", [np.zeros((2, 3)), np.ones(3), np.array([[1.0, math.nan]])])
def test_dictionary_is_refused(matrix):
    with pytest.raises(TuningError, match="dictionary"):
        Atoms(matrix)


@pytest.mark.parametrize("settings", [{"reading": "seperate"}, {"age": 0}, {"drift": (0.0, 1.0)}])
def test_carryover_is_refused(settings):
    with pytest.raises(TuningError):
        Carryover(**({"drift": (1.0, 2.0)} | settings))


def test_forces_that_nothing_shows():
    of = struck.system()
    still = dataclasses.replace(of, E=of.E * [1, 0, 1, 1])
    with pytest.raises(TuningError, match="force F2 moves no state"):
        estimator(of).compile(struck.model(still), struck.DT)
    blind = dataclasses.replace(of, A=np.diag(np.diag(of.A)), C=of.C * [1, 0, 1, 0])
    alone = dataclasses.replace(
        blind, E=np.array([[1.0, 0, 1, 1], [0, 1, 1, 1], [1, 0, 0, 0], [0, 1, 0, 0]])
    )
    with pytest.raises(TuningError, match="no sensor sees the force F2"):
        estimator(of).compile(struck.model(alone), struck.DT)


def test_modes_too_fast_for_the_sampling():
    made = struck_beam.estimator(0.003, eps_Q=1.0, eps_R=1e-8, lam=1.0)
    with pytest.raises(ModelError, match=r"153.7 Hz .*Nyquist"):
        made.compile(struck_beam.model(0.003), 1 / 200)


def test_native_runs_the_beam():
    made = struck_beam.estimator(0.0027, eps_Q=6.0, eps_R=1e-8, lam=1e-3)
    y = struck_beam.measured()
    rows = [np.zeros((len(y), 0)), y, np.ones_like(y)]
    recursion = made.compile(struck_beam.model(0.0027), struck_beam.DT)
    ends = [e.run(recursion, rows, carry=recursion.carry0)[0] for e in (vm, native)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6, atol=1e-8)


def test_the_bias_is_removed():
    """The optimum is linear in lam while the same forces are found: the fit is where lam is 0."""
    of = struck.system(accelerations=False)
    u, y = struck.record(of, 24, seed=5)
    runs = {
        (lam, bias): run(
            estimator(of, lam=lam, bias=bias, arrival=NoArrival(), lag=4), struck.model(of), u, y
        )
        for lam, bias in ((0.101, "kept"), (0.1, "kept"), (0.1, "removed"))
    }
    strong, weak, fitted = runs.values()
    same = np.all((strong["d_raw"] != 0) == (weak["d_raw"] != 0), axis=1)
    same &= (strong["nonzeros"] == weak["nonzeros"]).ravel() & weak["d_raw"].any(axis=1)
    assert same.sum() >= 3
    expected = weak["d_raw"] - 100 * (strong["d_raw"] - weak["d_raw"])
    np.testing.assert_allclose(fitted["d_raw"][same], expected[same], rtol=1e-6, atol=1e-8)
    np.testing.assert_array_equal(fitted["x_hat"], weak["x_hat"])
    bias = np.abs(fitted["d_raw"] - weak["d_raw"])
    assert np.all(fitted["d_std"] >= np.hypot(weak["d_std"], bias) * (1 - 1e-9))
