"""The merit of a trajectory: the sums of its definition, and a slope that is its derivative."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from backsight.solvers.trajectory._merit import merit
from backsight.solvers.trajectory.chain import Chain

NX, NY, N = 2, 1, 3
CHAIN = Chain(
    N=N,
    Q=np.array([[0.5, 0.1], [0.1, 0.3]]),
    F=ca.Sparsity.dense(NX, NX),
    H=ca.Sparsity.dense(NY, NX),
    noise=np.array([[0.0, 0.0], [1.0, 0.5], [0.3, -1.0]]),
    A=ca.Sparsity.dense(3, NX),
    softness=np.array([0.0, 0.0, 0.4]),
    slack=np.zeros(3),
)
HARD = CHAIN.softness == 0


@dataclasses.dataclass
class Point:
    """A trajectory and the step from it, all of it drawn at random."""

    seed: int

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        draw = rng.standard_normal
        root = draw((NX, NX))
        self.P, self.offset = root @ root.T, draw(NX)
        self.stages = {k: draw((size, N + 1)) for k, size in CHAIN.sizes.items()}
        self.stages["low"] = -0.2 * rng.random((3, N + 1))
        self.stages["high"] = 0.2 * rng.random((3, N + 1))
        self.stages["before"] = np.array([[0.0, 1.0, 0.5, 1.0]])
        self.eta, self.dX, self.eta_next = draw((NX, N + 1)), draw((NX, N + 1)), draw((NX, N + 1))
        self.nu = draw((3, N + 1))

    def __call__(self, *, free=0.0, proximal=False):
        paths = [self.eta, self.dX, self.eta_next, self.nu]
        given = [self.offset, CHAIN.stored(self.P), free, *self.stages.values(), *paths]
        J, slope, *sums = merit(CHAIN, proximal)(*given)
        return float(J), float(slope), *(np.array(s).ravel() for s in sums)

    def at(self, length):
        """The cost after a share of the step, by its definition."""
        s = self.stages
        eta = self.eta + length * (self.eta_next - self.eta)
        e = s["e"] - length * (s["H"] * self.dX).sum(axis=0)
        w = s["before"] * (CHAIN.Q @ eta)
        cost = eta[:, 0] @ self.P @ eta[:, 0] / 2 + (e**2).sum() / 2 + (eta * w).sum() / 2
        A = s["A"].reshape(NX, 3, N + 1)  # column by column
        value = CHAIN.noise @ w + length * np.einsum("krn,kn->rn", A, self.dX)
        excess = np.minimum(value - s["low"], 0) + np.maximum(value - s["high"], 0)
        return cost + (excess[~HARD] ** 2 / (2 * 0.4)).sum(), excess, w


@pytest.mark.parametrize("seed", range(4))
def test_sums_are_those_of_the_definition(seed):
    point = Point(seed)
    cost, slope, defects, adjoints, steps = point()
    expected, excess, w = point.at(0.0)
    assert cost == pytest.approx(expected, rel=1e-12)
    h = 1e-5
    difference = (point.at(h)[0] - point.at(-h)[0]) / (2 * h)
    assert slope == pytest.approx(difference, rel=1e-6)
    of_start = np.abs(point.offset + point.P @ point.eta[:, 0])
    of_motion = np.abs(point.stages["c"] + w).sum(axis=1)
    assert defects[:NX] == pytest.approx(of_start + of_motion, rel=1e-12)
    # A step must not buy a better cost with hard limits that it leaves.
    assert np.abs(excess[HARD]).sum() > 0
    assert defects[NX:] == pytest.approx(np.where(HARD, np.abs(excess).sum(axis=1), 0), rel=1e-12)
    of_defects = np.abs(point.eta_next - CHAIN.noise.T @ point.nu).max(axis=1)
    assert adjoints == pytest.approx([*of_defects, *np.abs(point.nu).max(axis=1)], rel=1e-12)
    assert steps == pytest.approx(np.abs(point.dX).max(axis=1), rel=1e-12)


def test_a_prior_that_goes_with_the_guess_costs_nothing():
    point = Point(9)
    J, slope, defects, *rest = point()
    J_free, slope_free, defects_free, *rest_free = point(free=1.0, proximal=True)
    moved, deta = point.P @ point.eta[:, 0], point.eta_next[:, 0] - point.eta[:, 0]
    assert J - J_free == pytest.approx(point.eta[:, 0] @ moved / 2, rel=1e-9)
    assert slope - slope_free == pytest.approx(moved @ deta, rel=1e-9)
    of_start = np.abs(point.offset + moved)
    assert (defects - defects_free)[:NX] == pytest.approx(of_start, rel=1e-9)
    np.testing.assert_array_equal(np.concatenate(rest), np.concatenate(rest_free))
    np.testing.assert_array_equal(point(free=0.0, proximal=True)[2], defects)
