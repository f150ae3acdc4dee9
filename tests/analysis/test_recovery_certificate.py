"""What is certified is found, and what is not has signs with which it is never found."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

import backsight as bs
from backsight.errors import TuningError

DT, N = 1 / 400, 7
PLACES = {f"F{i}": 0.15 + 0.06 * i for i in range(5)}
SENSORS = {f"s{i}": ("displacement", x) for i, x in enumerate((0.25, 0.33, 0.40))}


def beam(sensors=SENSORS, modes=3):
    return bs.beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502.0,
        modes=modes,
        damping=[0.03] * modes,
        sensors=sensors,
        forces=PLACES,
    )


def finder(**changed):
    known = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=2e-6),
        bs.Prior(sigma_x0=1e-3),
        forces=tuple(PLACES),
        lam=1e-3,
        N=N,
        arrival=bs.settings.NoArrival(),
    )
    return dataclasses.replace(known, **changed)


class Window:
    """Readings of a window by simulation, one unit at a time, and the smallest l1 norm."""

    def __init__(self, model):
        self.places = len(PLACES)
        joined = bs.forces.forces_as_inputs(model, list(PLACES))
        states, n = [s.name for s in model.states], N * self.places

        def readings(d, x0):
            motion = bs.simulate(joined, d, dt=DT, x0=x0)
            return motion["y"].values.ravel() / 2e-6

        still = np.zeros((N + 1, self.places))
        self.start = np.array([readings(still, {s: 1e-4}) for s in states]).T
        columns = []
        for i, j in itertools.product(range(N), range(self.places)):
            d = still.copy()
            d[i, j] = 1.0
            columns.append(readings(d, {}))
        self.atoms, self.n = np.array(columns).T, n

    def least(self, y, noise=0.0, sides=None):
        """Forces with the smallest l1 norm that explain y to within `noise`."""
        A = np.hstack([self.start, -self.start, self.atoms, -self.atoms])
        cost = np.append(np.zeros(2 * self.start.shape[1]), np.ones(2 * self.n))
        if sides is not None:
            A, cost = A[:, : -self.n], cost[: -self.n]
        found = (
            linprog(cost, A_ub=np.vstack([A, -A]), b_ub=np.append(y + noise, noise - y))
            if noise
            else linprog(cost, A_eq=A, b_eq=y)
        )
        assert found.status == 0
        parts = found.x[2 * self.start.shape[1] :].reshape(-1, self.n)
        return parts[0] - (parts[1] if len(parts) > 1 else 0.0)

    def column(self, age, place):
        return (N - age) * self.places + place


@pytest.fixture(scope="module")
def window():
    return Window(beam())


@pytest.fixture(scope="module")
def certified():
    return bs.check.check_recovery(finder(), beam(), dt=DT)


def certain(certified, age, chosen):
    """Whether it says that hits at these places, all at this age, are found."""
    if len(chosen) == 1:
        return bool(certified["ratio"].sel(age=age).values[chosen[0]] < 1)
    return bool(certified["pair_ratio"].values[chosen] < 1)


def right_and_wrong(window, certified, rng, runs):
    """Hits that are certain and are found; and signs of uncertain ones that are never found."""
    sets = [*((j,) for j in range(5)), *itertools.combinations(range(5), 2)]
    counts = {True: 0, False: 0}
    for _ in range(runs):
        age, chosen = rng.integers(1, N + 1), sets[rng.integers(len(sets))]
        sure = certain(certified, age, chosen)
        misses = []
        for signs in itertools.product([1.0, -1.0], repeat=len(chosen)):
            d = np.zeros(window.n)
            for place, sign in zip(chosen, signs, strict=True):
                d[window.column(age, place)] = sign * 10 ** rng.uniform(-1, 1)
            y = window.atoms @ d + window.start @ rng.standard_normal(window.start.shape[1])
            misses.append(np.abs(window.least(y) - d).max() > 1e-5 * np.abs(d).max())
        assert any(misses) != sure, (age, chosen, misses)
        counts[sure] += 1
    return counts


def test_certain_hits_are_found_and_others_need_not(window, certified):
    counts = right_and_wrong(window, certified, np.random.default_rng(3), 40)
    assert min(counts.values()) >= 5


@pytest.mark.slow
def test_certain_hits_are_found_in_ten_thousand_programs(window, certified):
    counts = right_and_wrong(window, certified, np.random.default_rng(4), 10_000)
    assert min(counts.values()) >= 1000


def test_the_moving_window_finds_what_is_certain(certified):
    chosen = np.argwhere(np.triu(certified["pair_ratio"].values < 0.98, 1))
    assert len(chosen)
    model = beam()
    known = bs.forces.forces_as_inputs(model, list(PLACES))
    for pair in chosen:
        d = np.zeros((20, 5))
        d[8, pair] = 4.0, -2.0
        recording = bs.simulate(known, d, dt=DT).isel(input=[])
        for lag in (N, 3):
            found = bs.estimate(finder(lag=lag), model, recording, engine="vm")
            assert found["d_raw"].values[8] == pytest.approx(d[8], abs=0.01)


def test_noise_moves_a_hit_no_further_than_said(window, certified):
    rng = np.random.default_rng(5)
    sure = np.argwhere(certified["ratio"].values < 0.98)
    for row, place in sure[:: len(sure) // 4]:
        age = int(certified["age"][row])
        bound = float(certified["error"].sel(age=age)[place])
        d = np.zeros(window.n)
        d[window.column(age, place)] = 5 * bound
        for _ in range(4):
            y = window.atoms @ d + 3.0 * rng.choice([-1.0, 1.0], len(window.atoms))
            off = np.abs(window.least(y, noise=3.0) - d)
            own = off[window.column(age, place)]
            assert own <= bound * (1 + 1e-6)
            assert off.sum() - own <= bound * (1 + 1e-6)


def test_the_worst_noise_reaches_what_is_said():
    """One place, one explanation: the bound by pseudo-inverse."""
    model = bs.modal(
        [9.0], damping=[0.03], sensors={"tip": ("displacement", [1.0])}, forces={"hit": [1.0]}
    )
    estimator = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=1.0), forces=("hit",), lam=1.0, N=2
    )
    found = bs.check.check_recovery(estimator, model, dt=0.01, ages=[2])
    # Three readings, two states, two steps: one way to explain everything by the other force.
    joined = bs.forces.forces_as_inputs(model, ["hit"])
    rows = [
        bs.simulate(joined, [[a], [b], [0]], dt=0.01, x0={"q1": q, "q1_dot": v})["y"].values.ravel()
        for q, v, a, b in np.eye(4)
    ]
    null = np.linalg.svd(np.array(rows).T)[2][-1]
    assert found["ratio"].values == pytest.approx(abs(null[2] / null[3]), rel=1e-6)


def test_known_signs_make_more_certain(certified):
    pushing = bs.check.check_recovery(finder(nonnegative=tuple(PLACES)), beam(), dt=DT, ages=[4])
    free, known = certified["pair_ratio"].values, pushing["pair_ratio"].values
    pairs = np.triu_indices(5, 1)
    assert (known[pairs] <= free[pairs] + 1e-6).all()
    assert (known[pairs] < 1).sum() > (free[pairs] < 1).sum()


def test_as_many_sensors_as_forces_leave_no_doubt():
    sensors = {f"s{i}": ("displacement", x) for i, x in enumerate((0.15, 0.21, 0.27, 0.33, 0.39))}
    found = bs.check.check_recovery(
        finder(), beam(sensors, modes=5), dt=1 / 2000, most=5, ages=[3, 4]
    )
    assert found.attrs["number"] == 5
    assert found["ratio"].values.max() < 0.2
    assert found.attrs["number_by_coherence"] <= 1
    assert "5 forces at once" in found.attrs["verdict"]


def test_what_cannot_be_judged_is_refused():
    with pytest.raises(TuningError, match="does not show all states"):
        bs.check.check_recovery(finder(N=2), beam({"s1": SENSORS["s1"]}), dt=DT)
    with pytest.raises(TuningError, match="whole numbers from 1 to 7"):
        bs.check.check_recovery(finder(), beam(), dt=DT, ages=[0])
