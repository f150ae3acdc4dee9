"""Beams of which something is not known, struck at unknown places, window by window."""

import math

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.analysis.forces import compare_forces
from backsight.engine import native
from backsight_studies.beam.plant import DAMPING, DT, FORCES, SENSORS, THICKNESS, N, frequencies
from backsight_studies.beam_random.scenarios import ByFrequencies, scenario

THIN, TRUE = THICKNESS[-10.0], THICKNESS[0.0]
SHAPES = {
    h: (ByFrequencies(h)(ByFrequencies(h).start()), 2 * np.pi * frequencies(h))
    for h in (THIN, TRUE)
}
Q, V, R = ("q1", "q2", "q3"), ("v1", "v2", "v3"), ("r1", "r2", "r3")


def places(thickness):
    """Mode shapes at forces (3, 8) and at sensors (3, 3)."""
    model = SHAPES[thickness][0]
    still, none = np.zeros(6), np.zeros(0)
    x, p = ca.SX.sym("x", 6), ca.SX.sym("p", 8)
    by_force = ca.jacobian(model.f(x, none, p), p)
    by_state = ca.jacobian(model.h(x, none, p), x)
    found = ca.Function("places", [x, p], [by_force, by_state])(still, np.zeros(8))
    return np.array(found[0])[3:], np.array(found[1])[:, :3]


def unsure(thickness):
    """From sample to sample, exactly, with relative errors of the frequencies as states."""
    (at_forces, at_sensors), w0 = places(thickness), SHAPES[thickness][1]

    def f(x, u, p):
        pushes = ca.DM(at_forces) @ ca.vertcat(*(p[name] for name in FORCES))
        q, v = [], []
        for i, zeta in enumerate(DAMPING):
            w = w0[i] * (1 + getattr(x, R[i]))
            turn, decay = w * math.sqrt(1 - zeta**2), ca.exp(-zeta * w * DT)
            c, s = decay * ca.cos(turn * DT), decay * ca.sin(turn * DT) / turn
            now, rate = getattr(x, Q[i]), getattr(x, V[i])
            q.append(
                (c + zeta * w * s) * now + s * rate + (1 - c - zeta * w * s) / w**2 * pushes[i]
            )
            v.append(-(w**2) * s * now + (c - zeta * w * s) * rate + s * pushes[i])
        return [*q, *v, *(getattr(x, name) for name in R)]

    return bs.Model(
        f=f,
        h=lambda x, u, p: ca.vertsplit(ca.DM(at_sensors) @ ca.vertcat(x.q1, x.q2, x.q3)),
        states=dict.fromkeys((*Q, *V, *R), ""),
        inputs={},
        outputs=dict.fromkeys(SENSORS, "m"),
        parameters=dict.fromkeys(FORCES, (0.0, "N")),
        dt=DT,
    )


def hardening(cubic, *, joint):
    """The beam with a spring at its tip that hardens; how much may be a state, in parts of it."""
    (at_forces, at_sensors), w = places(TRUE), SHAPES[TRUE][1]

    def f(x, u, p):
        q, v = [[getattr(x, name) for name in names] for names in (Q, V)]
        tip = sum(at_sensors[2, i] * q[i] for i in range(3))
        pull = cubic * tip**3 * (x.k if joint else 1.0)
        pushes = ca.DM(at_forces) @ ca.vertcat(*(p[name] for name in FORCES))
        rates = [
            pushes[i] - w[i] ** 2 * q[i] - 2 * DAMPING[i] * w[i] * v[i] - at_sensors[2, i] * pull
            for i in range(3)
        ]
        return [*v, *rates, *([0.0] if joint else [])]

    return bs.Model(
        f=f,
        h=lambda x, u, p: ca.vertsplit(ca.DM(at_sensors) @ ca.vertcat(x.q1, x.q2, x.q3)),
        states=dict.fromkeys((*Q, *V, *(["k"] if joint else [])), ""),
        inputs={},
        outputs=dict.fromkeys(SENSORS, "m"),
        parameters=dict.fromkeys(FORCES, (0.0, "N")),
    )


def method(prior, **settings):
    spread = {**dict.fromkeys(Q, 1e-5), **dict.fromkeys(V, 1e-3), **prior}
    expected = bs.forces.Carryover((1e3, 1e4), age=4)
    return bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=spread), forces=FORCES, N=N, lam=20.0,
        sigma_force=0.05, threshold=1.0, carryover=expected, **settings
    )  # fmt: skip


def run(recursion, y):
    data = [np.zeros((len(y), 0)), y, np.ones_like(y)]
    _, outputs = native.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


def f1(found, d):
    shown = found["d_hat"][N:]
    return compare_forces(shown, d[: len(shown)], least=1.0).f1


@pytest.mark.slow
def test_blind_frequencies_that_are_ten_per_cent_wrong():
    """The scenes of the study and as many others: all hits, and three frequencies."""
    recursion = method(dict.fromkeys(R, 0.1)).compile(unsure(THIN), DT)
    true = frequencies(TRUE) / frequencies(THIN) - 1
    for seeds in (range(50), range(50, 100)):
        scores, errors, sure = [], [], []
        for s in map(scenario, seeds):
            found = run(recursion, s.recording["y"].values)
            off = found["x_hat"][-1][6:] - true
            scores.append(f1(found, s.d))
            errors.append(np.abs(off / (1 + true)))
            sure.append(np.abs(off) < 3 * np.sqrt(np.diag(found["P"][-1])[6:]))
            assert not found["status"].any()
        assert np.mean(scores) >= 0.95
        assert np.median(errors, axis=0).max() < 0.005
        assert np.mean(sure) > 0.95


@pytest.mark.slow
def test_a_support_that_hardens_by_how_much_is_not_known():
    """It pulls as hard as the beam itself at 1.5 mm; two hits; the linear beam finds others."""
    w, tip = SHAPES[TRUE][1], places(TRUE)[1][2]
    cubic = 1 / np.sum(tip**2 / w**2) / 0.0015**2
    true = bs.forces.forces_as_inputs(hardening(cubic, joint=False), list(FORCES))
    bent = method({"k": 0.5}).compile(hardening(cubic, joint=True), DT)
    straight = method({}).compile(hardening(0.0, joint=False), DT)
    scores, linear, off = [], [], []
    for seed in range(30):
        rng, d = np.random.default_rng([seed, 7]), np.zeros((61, 8))
        first = int(rng.integers(3, 20))
        for step in (first, int(rng.integers(first + 8, 61 - N))):
            d[step, rng.integers(8)] = rng.uniform(3, 12) * rng.choice([-1, 1])
        y = bs.simulate(true, d, dt=DT, sigma_y=1e-5, seed=seed)["y"].values
        found = run(bent, y)
        scores.append(f1(found, d))
        linear.append(f1(run(straight, y), d))
        off.append(abs(found["x_hat"][-1][6] - 1) / np.sqrt(found["P"][-1][6, 6]))
    assert np.mean(scores) >= 0.9
    assert np.mean(linear) < 0.6
    assert np.mean(np.array(off) < 3) > 0.9
