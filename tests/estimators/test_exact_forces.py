"""Forces of which nothing is known, with sensors that have no noise."""

import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import TuningError
from backsight.schema import Status
from estimators.forced_plants import DT, PLACES, cantilever, chain, plant

TWO = ("F1", "F3")
SPREAD = {"displacement": 1e-6, "acceleration": 1e-1}
"""Noise of a sensor that has some."""

SAMPLES = (3, 5, 13)
"""Those that are compared."""


def conditioned(p, y, *, Q, R, P0, samples, smoothed=False):
    """States and forces given the readings so far, by null spaces; forces are flat.

    The start, the process noise and that of the sensors are z of variance one, forces are d;
    readings are M z + G d = y. What the rows say without d fixes z, as far as it goes, and the rest
    says what d is. Of every sample asked for: mean and covariance of (state, force that is found);
    `smoothed` given all readings.
    """
    n, (ny, nx), m = len(y), p.C.shape, p.E.shape[1]
    factor = [np.linalg.eigh(S) for S in (P0, Q, R)]
    start, walk, noise = (V * np.sqrt(np.maximum(v, 0)) for v, V in factor)
    lag = 0 if p.F.any() else 1
    by_z, by_d = np.zeros((nx, (nx + ny) * n)), np.zeros((nx, m * n))
    by_z[:, :nx] = start
    rows, states = [], []
    for k in range(n):
        shown, forced = p.C @ by_z, p.C @ by_d
        shown[:, nx * n + ny * k : nx * n + ny * (k + 1)] = noise
        forced[:, m * k : m * (k + 1)] += p.F
        kept = np.isfinite(y[k])
        rows.append((shown[kept], forced[kept], y[k][kept]))
        states.append((by_z, by_d))
        by_z, by_d = p.A @ by_z, p.A @ by_d
        by_d[:, m * k : m * (k + 1)] += p.E
        if k + 1 < n:
            by_z[:, nx * (k + 1) : nx * (k + 2)] += walk
    found = []
    for k in samples:
        until = n if smoothed else k + 1
        M, G, told = (np.concatenate(parts) for parts in zip(*rows[:until], strict=True))
        known = slice(0, m * (until - lag))  # the force ahead has not shown yet
        G = G[:, known]
        without = scipy.linalg.null_space(G.T).T
        inverse = np.linalg.pinv(without @ M, rcond=1e-11)
        z, free = inverse @ without @ told, np.eye(M.shape[1]) - inverse @ without @ M
        back = np.linalg.pinv(G)
        d, d_free = back @ (told - M @ z), -back @ M @ free
        of_z, of_d = states[k][0], states[k][1][:, known]
        last = slice(m * (k - lag), m * (k + 1 - lag))
        left = np.vstack([of_z @ free + of_d @ d_free, d_free[last]])
        found.append((np.concatenate([of_z @ z + of_d @ d, d[last]]), left @ left.T))
    return [np.array(part) for part in zip(*found, strict=True)]


def agrees(estimator, model, *, forces, R, P0, Q):
    """Compare all of states, forces and covariances with `conditioned`, in their own sizes."""
    p, rng, n, m = plant(model, forces), np.random.default_rng(5), 14, len(forces)
    nx = len(p.A)
    walk, noise = (np.linalg.cholesky(S + 1e-300 * np.eye(len(S))) for S in (Q, R))
    x0 = np.sqrt(np.diag(P0)) * rng.standard_normal(nx)
    _, y = p.run(
        4.0 * rng.standard_normal((n, m)), x0=x0, w=rng.standard_normal((n, nx)) @ walk.T,
        v=rng.standard_normal((n, len(R))) @ noise.T,
    )  # fmt: skip
    y[6, 1] = np.nan
    recording = bs.from_arrays(
        y=y, inputs={}, outputs={s.name: s.unit for s in model.outputs}, dt=DT
    )
    for smoothed in (False, True):
        find = bs.smooth if smoothed else bs.estimate
        result = find(estimator, model, recording, engine="vm")
        assert not result["status"].any()
        compared(result, conditioned(p, y, Q=Q, R=R, P0=P0, samples=SAMPLES, smoothed=smoothed), P0)


def compared(result, expected, P0):
    (mean, P), nx = expected, len(P0)
    at = result.isel(time=list(SAMPLES))
    spread = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    size = np.sqrt(np.diag(P0))
    np.testing.assert_allclose(at["x_hat"].values / size, mean[:, :nx] / size, atol=1e-9)
    np.testing.assert_allclose(at["d_hat"].values, mean[:, nx:], atol=1e-7)
    np.testing.assert_allclose(
        at["P"].values / np.outer(size, size), P[:, :nx, :nx] / np.outer(size, size), atol=1e-9
    )
    np.testing.assert_allclose(at["d_std"].values, spread[:, nx:], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("kind", ["displacement", "acceleration"])
@pytest.mark.parametrize("exact", [(0, 1, 2), (1,), (0, 2)])
def test_forces_are_those_of_conditioning(kind, exact):
    model = cantilever(kind)
    n = model.nx // 2
    R = np.diag([0.0 if i in exact else SPREAD[kind] ** 2 for i in range(3)])
    P0 = np.diag([1e-8] * n + [1e-4] * n)
    Q = 1e-3 * P0
    estimator = bs.JointInput(bs.Noise(R=R, Q=Q), bs.Prior(P0=P0), forces=TWO)
    agrees(estimator, model, forces=TWO, R=R, P0=P0, Q=Q)


def test_many_states_and_their_gaps():
    """A chain of 14 states: kernels in place of straight-line code; two of one thing."""
    model = chain("displacement")
    n = model.nx // 2
    P0 = np.diag([1e-8] * n + [1e-4] * n)
    estimator = bs.JointInput(bs.Noise(sigma_y=0.0, Q=1e-3 * P0), bs.Prior(P0=P0), forces=("F1",))
    agrees(estimator, model, forces=("F1",), R=np.zeros((3, 3)), P0=P0, Q=1e-3 * P0)


def test_two_exact_sensors_of_one_thing_count_once():
    model, rng = cantilever("displacement", sensors=(*PLACES, PLACES[2])), np.random.default_rng(2)
    p, n = plant(model, TWO), model.nx // 2
    _, y = p.run(rng.standard_normal((8, 2)))
    names = {s.name: s.unit for s in model.outputs}
    recording = bs.from_arrays(y=y, inputs={}, outputs=names, dt=DT)
    prior = bs.Prior(P0=np.diag([1e-8] * n + [1e-4] * n))
    noise = bs.Noise(sigma_y=0.0, sigma_w=1e-6)
    found = bs.estimate(
        bs.JointInput(noise, prior, forces=TWO), model, recording, engine="vm", throw=False
    )
    once = cantilever("displacement")
    three = bs.from_arrays(y=y[:, :3], inputs={}, outputs=dict(list(names.items())[:3]), dt=DT)
    expected = bs.estimate(bs.JointInput(noise, prior, forces=TWO), once, three, engine="vm")
    np.testing.assert_allclose(found["d_hat"], expected["d_hat"], atol=1e-8)
    np.testing.assert_allclose(found["x_hat"], expected["x_hat"], atol=1e-13)
    assert (found["status"] == int(Status.REDUNDANT)).all()


def test_a_bent_spring_is_the_limit_of_small_noise():
    """A nonlinear model: linearised at every estimate, with an exact encoder and tachometer."""
    model = bs.Model(
        f=lambda x, u, p: [x.v, -50 * x.q - 400 * x.q**3 - x.v + p.F],
        h=lambda x, u, p: [x.q, x.v],
        states={"q": "m", "v": "m/s"},
        outputs={"q": "m", "v": "m/s"},
        parameters={"F": (0.0, "N")},
    )
    rng = np.random.default_rng(1)
    y = np.cumsum(rng.standard_normal((20, 2)) * [0.01, 0.05], axis=0)
    recording = bs.from_arrays(y=y, inputs={}, outputs={"q": "m", "v": "m/s"}, dt=0.02)
    prior = bs.Prior(sigma_x0=0.1)
    exact, small = (
        bs.estimate(
            bs.JointInput(
                bs.Noise(sigma_y=sigma, sigma_w=0.01), prior, forces=("F",), sigma_force=50.0
            ),
            model, recording, engine="vm",
        )
        for sigma in (0.0, 1e-7)
    )  # fmt: skip
    np.testing.assert_allclose(exact["x_hat"], y, atol=1e-12)
    for name, size in (("x_hat", 1.0), ("d_hat", 10.0), ("d_std", 10.0)):
        np.testing.assert_allclose(exact[name], small[name], atol=1e-4 * size)


def test_what_a_force_unseen_may_be_must_be_said_where_nothing_else_does():
    model = cantilever("displacement")
    still = bs.Prior(P0=np.zeros((model.nx, model.nx)))
    estimator = bs.JointInput(bs.Noise(sigma_y=0.0, sigma_w=1e-6), still, forces=TWO)
    with pytest.raises(TuningError, match="give sigma_force"):
        estimator.compile(model, DT)
    dataclasses.replace(estimator, sigma_force=10.0).compile(model, DT)
