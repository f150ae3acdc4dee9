"""Limits of the compressive-sensing window (eq. 14) against CVXPY with Clarabel."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight import schema
from backsight.engine import vm
from backsight.errors import TuningError
from backsight.forces import HalfSines
from estimators import struck
from oracles.sparse_forces import pulses

cp = pytest.importorskip("cvxpy")

N, LAM = 5, 0.6
FREE = {"forces": struck.FORCES, "lam": LAM, "N": N, "sigma_force": struck.SIGMA_FORCE, "lag": 2}
LIMIT = bs.settings.Limit


def estimator(of, **settings):
    return bs.CompressiveSensingMHE(**struck.gaussians(of), **FREE, bias="kept", **settings)


def run(made, model, u, y):
    recursion = made.compile(model, struck.DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def solve(of, made, y, u, bounds):
    """States (samples, nx), forces (samples, nf) and the largest multiplier of a limit."""
    samples, nx, noise = len(y), len(struck.X0), of.noise
    shapes = made.dictionary.shapes(4)
    steps = samples if of.F.any() else samples - 1
    first, w = cp.Variable(nx), [cp.Variable(noise.shape[1]) for _ in range(samples)]
    alpha = cp.Variable((max(steps, 1), shapes.shape[2]))
    x, xs, cost, limits = struck.X0 + np.linalg.cholesky(struck.P0) @ first, [], 0, []
    for k in range(samples):
        d = sum(
            (shapes[:, s, :] @ alpha[k - s] for s in range(shapes.shape[1]) if 0 <= k - s < steps),
            np.zeros(4),
        )
        both = noise @ w[k]
        v = y[k] - of.C @ x - of.D @ u[k] - of.F @ d - both[nx:]
        seen = np.isfinite(y[k])
        white = np.linalg.inv(np.linalg.cholesky(of.R[np.ix_(seen, seen)]))
        picked = np.flatnonzero(seen)
        if len(picked):
            cost += cp.sum_squares(white @ cp.hstack([v[i] for i in picked]))
        cost += cp.sum_squares(w[k])
        for limit in bounds:
            weights = np.array([*limit.weights.values()])
            if limit.of == "state":
                value = weights @ x[[("a", "b", "va", "vb").index(n) for n in limit.weights]]
            elif limit.of == "noise":
                value = weights @ both[[("a", "b", "va", "vb").index(n) for n in limit.weights]]
            elif all(seen[("y", "z").index(n)] for n in limit.weights):
                value = weights @ cp.hstack([v[("y", "z").index(n)] for n in limit.weights])
            else:
                continue
            limits += [value <= limit.upper] if np.isfinite(limit.upper) else []
            limits += [value >= limit.lower] if np.isfinite(limit.lower) else []
        xs.append(x)
        x = of.A @ x + of.B @ u[k] + of.E @ d + both[:nx]
    if steps:
        limits += [cp.abs(alpha) <= made.largest] if np.isfinite(made.largest) else []
        cost += LAM * cp.sum(cp.abs(alpha))
    problem = cp.Problem(cp.Minimize(cost + cp.sum_squares(first)), limits)
    problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
    pushes = max((float(np.max(c.dual_value)) for c in limits), default=0.0)
    forces = pulses(alpha.value if steps else np.zeros((0, shapes.shape[2])), shapes, samples)
    return np.array([k.value for k in xs]), forces, pushes


def of_arrays(u, y):
    return bs.from_arrays(u=u, y=y, dt=struck.DT, inputs={"f": "N"}, outputs={"y": "m", "z": "m"})


CASES = {
    "state": {"limits": (LIMIT("a", {"a": 1.0}, upper=0.004, lower=-0.006),)},
    "sum": {"limits": (LIMIT("s", {"a": 1.0, "b": -0.7}, upper=0.003),)},
    "speed": {"limits": (LIMIT("v", {"va": 1.0}, upper=0.05, lower=-0.05),)},
    "residual": {"limits": (LIMIT("r", {"y": 1.0}, upper=4e-4, lower=-4e-4, of="residual"),)},
    "noise": {"limits": (LIMIT("n", {"va": 1.0}, upper=5e-4, lower=-4e-4, of="noise"),)},
    "largest": {"largest": 3.0},
    "largest pulses": {"largest": 2.0, "dictionary": HalfSines((1, 2))},
    "all": {
        "largest": 5.0,
        "limits": (
            LIMIT("a", {"a": 1.0}, upper=0.01),
            LIMIT("v", {"vb": 1.0}, lower=-0.05, upper=0.05),
            LIMIT("n", {"va": 1.0}, upper=4e-3, lower=-4e-3, of="noise"),
        ),
    },
}


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("case", list(CASES))
def test_limits_are_kept_exactly(case, accelerations):
    """Windows that fill, and full ones; with a gap."""
    of = struck.system(accelerations=accelerations)
    made = estimator(of, **CASES[case])
    u, y = struck.record(of, N + 1, seed=3)
    y[1, 0] = np.nan
    found = run(made, struck.model(of), u, y)
    pushed = 0.0
    for k in range(N + 1):
        x, forces, pushes = solve(of, made, y[: k + 1], u[: k + 1], made.limits)
        pushed = max(pushed, pushes)
        at = max(k - 2, 0)
        scale = np.sqrt(np.diag(struck.P0))
        np.testing.assert_allclose(found["x_hat"][k] / scale, x[at] / scale, atol=5e-6)
        np.testing.assert_allclose(found["d_raw"][k], forces[at], atol=5e-5)
        clipped = bool(int(found["status"][k]) & schema.Status.CLIPPED)
        assert clipped == (pushes > 1e-4), pushes
    assert pushed > 1e-2
    assert found["gap"].max() < 1e-9


def test_limits_are_refused_where_nothing_keeps_them():
    """By what takes a whole recording at once; the moving window has them."""
    of = struck.system(accelerations=False)
    plant, made = struck.model(of), estimator(of)
    first = dataclasses.replace(plant.states[0], upper=1.0)
    bounded = dataclasses.replace(plant, states=(first, *plant.states[1:]))
    data = of_arrays(*struck.record(of, 8, seed=1))
    for model, method in ((bounded, made), (plant, dataclasses.replace(made, largest=5.0))):
        with pytest.raises(TuningError, match="kept by the moving window only"):
            bs.forces.find_sparse_forces(method, model, data)
    estimator(of).compile(bounded, struck.DT)


def test_limits_that_contradict_each_other_are_named():
    """The estimate is then the one without limits."""
    of = struck.system()
    model = struck.model(of)
    low, high = LIMIT("low", {"a": 1.0}, lower=0.02), LIMIT("high", {"a": 1.0}, upper=0.01)
    u, y = struck.record(of, 9, seed=3)
    found = run(estimator(of, limits=(low, high)), model, u, y)
    free = run(estimator(of), model, u, y)
    assert (found["status"].astype(int) & int(schema.Status.INFEASIBLE)).all()
    assert (found["infeasible"] == 1).all()
    for name in ("x_hat", "P", "d_raw", "d_std"):
        size = np.abs(free[name]).max()
        np.testing.assert_allclose(found[name], free[name], rtol=0, atol=1e-9 * size)


def test_an_expected_force_moves_no_further_than_its_change():
    """With hardly any change a force keeps its first value while it is in the window."""
    of = struck.system(accelerations=True)
    u, y = struck.record(of, 20, seed=3)
    values = {}
    for change in (1e-6, np.inf):
        carry = bs.forces.Carryover((2.0, 30.0), change=change)
        made = estimator(of, carryover=carry, threshold=0.5)
        found = [run(dataclasses.replace(made, lag=lag), struck.model(of), u, y) for lag in (2, 3)]
        early, late = (k["d_raw"][lag:] for lag, k in zip((2, 3), found, strict=True))
        n = len(late) - 1
        shared = (early[N:n] != 0) & (late[N:n] != 0)
        values[change] = np.abs(early[N:n] - late[N:n])[shared].max()
    assert values[1e-6] < values[np.inf]
