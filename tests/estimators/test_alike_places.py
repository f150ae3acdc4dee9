"""Forces at places that sensors can hardly tell apart: what their bands may be made of."""

import dataclasses

import numpy as np

import backsight as bs
from backsight.engine import vm
from estimators import struck

FORCES = 12.0
"""Largest of `struck.record`."""


def test_a_difference_that_rounding_makes_widens_no_band():
    """Four places in two modes, weighted so little that nearly all of them could be chosen.

    With whatever is left of such differences, the largest deviation is 670 000 N.
    """
    of = struck.system(accelerations=True)
    u, y = struck.record(of, 60, seed=1)
    precise = dataclasses.replace(of, R=1e-4 * of.R, Q=1e-4 * of.Q)
    made = bs.CompressiveSensingMHE(
        bs.Noise(R=precise.R, Q=precise.Q),
        bs.Prior(P0=struck.P0, x0=struck.X0),
        forces=struck.FORCES,
        lam=0.03,
        N=6,
    )
    recursion = made.compile(struck.model(of), struck.DT)
    _, outputs = vm.run(recursion, [u, y, np.ones_like(y)], carry=recursion.carry0)
    found = dict(zip([c.name for c in recursion.channels], outputs, strict=True))
    acting = found["d_std"][found["d_std"] > 0]
    assert len(acting) > 50
    assert FORCES / 100 < acting.max() < 10 * FORCES
