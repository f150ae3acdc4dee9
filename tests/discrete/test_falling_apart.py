"""A large model that falls apart goes to discrete time as its parts do, and as a whole."""

import itertools

import numpy as np
import pytest
import scipy

from backsight.discrete import _falling_apart
from backsight.discrete.exact import foh, zoh
from backsight.discrete.noise import discretise_noise

RNG = np.random.default_rng(0)
ORDER = RNG.permutation(40)
"""Modes whose states lie anywhere."""


def scattered(blocks):
    whole = scipy.linalg.block_diag(*blocks)
    return whole[np.ix_(ORDER, ORDER)]


A = scattered([[[0.0, 1.0], [-((2 + i) ** 2), -0.1 * i]] for i in range(20)])
B = RNG.standard_normal((40, 2))
DENSITY = scattered([[[0.0, 0.0], [0.0, 1.0 + i]] for i in range(20)])


@pytest.mark.parametrize("shared", [False, True])
def test_as_all_together(monkeypatch, shared):
    """The noise of two modes may be shared, so that they are one part."""
    density = DENSITY.copy()
    if shared:
        velocities = np.flatnonzero(np.diag(density))[:2]
        density[np.ix_(velocities, velocities)] += 0.5

    def all_of_it():
        return *zoh(A, B, dt=0.05), *foh(A, B, dt=0.05), *discretise_noise(A, density, dt=0.05)

    parts = [sorted(part) for part in _falling_apart.independent_parts(A, density)]
    assert len(parts) == 20 - shared
    assert sorted(itertools.chain(*parts)) == list(range(40))
    apart = all_of_it()
    monkeypatch.setattr(_falling_apart, "LARGE", 1000)
    for one, other in zip(apart, all_of_it(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14 * np.abs(other).max())
