"""A force at its largest size: what the status says of the sample at which it acts."""

import numpy as np

import backsight as bs
from backsight.engine import vm
from backsight.schema import Status
from estimators import struck

AT, N = 5, 4


def test_the_sample_of_the_hit_is_said_to_be_clipped():
    """At its sample the hit is in the first step of the window, and nothing else is at a limit."""
    of = struck.system()
    x, outputs = np.zeros(4), []
    for k in range(AT + N + 3):
        d = np.array([9.0 * (k == AT), 0, 0, 0])
        outputs.append(of.C @ x + of.F @ d)
        x = of.A @ x + of.E @ d
    y = np.array(outputs)
    made = bs.CompressiveSensingMHE(
        bs.Noise(R=1e-4 * of.R, Q=of.Q),
        bs.Prior(P0=struck.P0, x0=np.zeros(4)),
        forces=("F1",),
        lam=0.6,
        N=N,
        largest=8.5,
    )
    recursion = made.compile(struck.model(of), struck.DT)
    _, found = vm.run(
        recursion, [np.zeros((len(y), 1)), y, np.ones_like(y)], carry=recursion.carry0
    )
    named = dict(zip([c.name for c in recursion.channels], found, strict=True))
    hit = named["d_hat"][:, 0][N + AT]
    assert hit == 8.5
    clipped = (named["status"].ravel().astype(int) & int(Status.CLIPPED)) > 0
    assert clipped[N + AT]
    assert not clipped[N + AT + 1 :].any()
