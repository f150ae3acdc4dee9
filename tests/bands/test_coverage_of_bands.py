"""Do 3-sigma bands hold the truth as often as they say, for every estimator?"""

import numpy as np
import pytest

from backsight.engine.lanes import run_many
from backsight.estimators import ESTIMATORS
from backsight.run.estimation.carrying import from_first_sample, run_on
from bands.plants import Plant, Runs, drawn
from bands.rows import PLANTS, ROWS, Row

RUNS = 400
SAMPLES = {
    "oscillator": 100, "pendulum": 200, "known pendulum": 100, "slope": 40, "damping": 250
}  # fmt: skip
LEAST, MOST = 0.985, 0.999
CELLS = [
    pytest.param(name, plant, id=f"{name}-{plant}")
    for name, row in ROWS.items()
    for plant in PLANTS
    if plant not in row.why_not
]


def pushes(row: Row, n: int, runs: int) -> np.ndarray | None:
    """Unknown forces (n, runs): none, any size at any time, or one hit in forty samples."""
    if row.forces == "none":
        return None
    rng = np.random.default_rng(7)
    size = 40.0 * rng.standard_normal((n, runs))
    if row.forces == "any":
        return size
    hits = np.where(rng.random((n, runs)) < 0.025, 150.0 * np.sign(size) + size, 0.0)
    hits[:5] = hits[-10:] = 0.0
    return hits


def held(row: Row, plant: Plant, truth: Runs) -> np.ndarray:
    """Where the bands hold the truth, (runs, n, nx)."""
    recursion = row.build(plant).compile(plant.model, plant.dt)
    n, runs = truth.y.shape
    data = [run_on([truth.u, truth.y[:, [k]], np.ones((n, 1))], recursion.lag) for k in range(runs)]
    outcomes = run_many(recursion, data, carries=[recursion.carry0] * runs, threads=1)
    of = {c.name: i for i, c in enumerate(recursion.channels)}
    inside = []
    for k, (_, raw) in enumerate(outcomes):
        values = from_first_sample(raw, recursion.lag)
        x, P = (recursion.channels[of[v]].unpack(values[of[v]]) for v in ("x_hat", "P"))
        width = 3 * np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        inside.append(np.abs(x - truth.x[:, :, k]) <= width * (1 + 1e-12))
    return np.array(inside)


def test_every_estimator_has_a_row_and_every_gap_a_reason():
    assert {row.kind for row in ROWS.values()} == set(ESTIMATORS)
    for row in ROWS.values():
        assert set(row.why_not) < set(PLANTS)
        assert all(row.why_not.values())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "on"), CELLS)
def test_bands_hold_the_truth(name, on):
    """All samples from the first one on, all states, and each state by itself."""
    plant, n = PLANTS[on](), SAMPLES[on]
    truth = drawn(plant, RUNS, n, seed=1, pushes=pushes(ROWS[name], n, RUNS))
    inside = held(ROWS[name], plant, truth)
    assert LEAST <= inside.mean() <= MOST
    assert inside.mean(axis=(0, 1)).min() >= LEAST
