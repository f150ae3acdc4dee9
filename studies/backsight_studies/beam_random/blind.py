r"""Frequencies that nobody knows: how well a recording can tell them, and how well they are told.

The Cramér-Rao bound is that of all that is unknown once places and moments of the hits are known:
the first state, the three frequencies, and the sizes. Derivatives of the motion are differences of
exact steps, so that nothing of the estimators is in it. ``python -m
backsight_studies.beam_random.blind`` prints both for random beams, in a minute.
"""

import argparse
import dataclasses
import math

import casadi as ca
import numpy as np
from scipy.stats import norm

import backsight as bs
from backsight.models.signals import Named
from backsight.types import Array
from backsight_studies.beam.plant import DAMPING, DT, FORCES, SENSORS, THICKNESS, frequencies
from backsight_studies.beam_random.scenarios import NOISE, Scenario, response_shapes, scenario

SIGMA_Q, SIGMA_V, SIGMA_RATIO = 1e-5, 1e-3, 0.1
"""Prior of modal states, and of the frequencies, as a share."""

CLOSE = 0.005
"""Share of a frequency that counts as right."""

MODES = range(3)


@dataclasses.dataclass(frozen=True)
class Known:
    """How well frequencies are known, one row for each recording.

    Parameters
    ----------
    bound : (recordings, 3) array
        Least standard deviation, as a share.
    error : (recordings, 3) array
        Error of the moving window at the end.
    f1 : (recordings,) array
        Of its hits.
    """

    bound: Array
    error: Array
    f1: Array

    def __str__(self) -> str:
        """As a table."""
        possible = (2 * norm.cdf(CLOSE / self.bound) - 1).mean(axis=0)
        rows = {
            "least deviation, median [%]": 100 * np.median(self.bound, axis=0),
            "error of the window, median [%]": 100 * np.median(np.abs(self.error), axis=0),
            "right at best [% of recordings]": 100 * possible,
            "right in the window [%]": 100 * (np.abs(self.error) < CLOSE).mean(axis=0),
        }
        lines = [f"{name:34s}" + "".join(f"{v:8.2f}" for v in row) for name, row in rows.items()]
        return "\n".join([*lines, f"F1 of the hits {self.f1.mean():.3f}"])


def outputs(first: Array, hertz: Array, d: Array) -> Array:
    """Readings (n, 3) of modes that swing with these frequencies, by exact steps."""
    B, C = response_shapes(THICKNESS[0.0])
    x, rows = first, []
    A, G = _exact(hertz)
    for force in d @ B[3:].T:
        rows.append(C[:, :3] @ x[:3])
        x = A @ x + G @ force
    return np.array(rows)


def _exact(hertz: Array) -> tuple[Array, Array]:
    """One step of all modes, and what a held modal force does in it."""
    A, G = np.zeros((6, 6)), np.zeros((6, 3))
    for i in MODES:
        w, z = 2 * math.pi * hertz[i], DAMPING[i]
        a, wd = z * w, w * math.sqrt(1 - z**2)
        e, c, s = math.exp(-a * DT), math.cos(wd * DT), math.sin(wd * DT)
        A[i, i], A[i, i + 3] = e * (c + a / wd * s), e * s / wd
        A[i + 3, i], A[i + 3, i + 3] = -(w**2) / wd * e * s, e * (c - a / wd * s)
        G[i, i], G[i + 3, i] = (1 - A[i, i]) / w**2, e * s / wd
    return A, G


def bound(d: Array) -> Array:
    """Least standard deviations of the frequencies, as shares, of beams with such hits."""
    hits = np.argwhere(d)
    hertz = np.array(frequencies(THICKNESS[0.0]))

    def shown(z: Array) -> Array:
        moved = d.copy()
        moved[tuple(hits.T)] += z[9:]
        return outputs(z[:6], hertz * (1 + z[6:9]), moved).ravel()

    sizes = np.concatenate([np.full(3, SIGMA_Q), np.full(3, SIGMA_V), np.full(3, SIGMA_RATIO)])
    step = np.concatenate([1e-2 * sizes[:6], np.full(3, 1e-6), np.full(len(hits), 1e-3)])
    columns = [
        (shown(h * e) - shown(-h * e)) / (2 * h)
        for h, e in zip(step, np.eye(len(step)), strict=True)
    ]
    J = np.array(columns).T / NOISE
    known = np.concatenate([sizes**-2.0, np.zeros(len(hits))])
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J + np.diag(known)))[6:9])


def joint() -> bs.Model:
    """The beam, 10 % too thin, whose frequencies are states as shares of what they seem to be."""
    B, C = response_shapes(THICKNESS[-10.0])
    seeming = 2 * math.pi * np.array(frequencies(THICKNESS[-10.0]))

    def f(x: Named, _: Named, p: Named) -> list[ca.SX]:
        g = ca.DM(B[3:]) @ ca.vertcat(*(p[name] for name in FORCES))
        q, v, r = ([x[f"{s}{i}"] for i in MODES] for s in "qvr")
        ends = []
        for i in MODES:
            w = seeming[i] * (1 + r[i])
            a, wd = DAMPING[i] * w, w * math.sqrt(1 - DAMPING[i] ** 2)
            e, c, s = ca.exp(-a * DT), ca.cos(wd * DT), ca.sin(wd * DT)
            still = e * (c + a / wd * s)
            ends.append(
                (
                    still * q[i] + e * s / wd * v[i] + (1 - still) / w**2 * g[i],
                    -(w**2) / wd * e * s * q[i] + e * (c - a / wd * s) * v[i] + e * s / wd * g[i],
                )
            )
        return [*(end for end, _ in ends), *(end for _, end in ends), *r]

    def h(x: Named, _: Named, __: Named) -> list[ca.SX]:
        return ca.vertsplit(ca.DM(C[:, :3]) @ ca.vertcat(*(x[f"q{i}"] for i in MODES)))

    return bs.Model(
        f=f,
        h=h,
        states=dict.fromkeys((f"{s}{i}" for s in "qvr" for i in MODES), ""),
        inputs={},
        outputs=dict.fromkeys(SENSORS, "m"),
        parameters=dict.fromkeys(FORCES, (0.0, "N")),
        dt=DT,
        name="beam of unknown frequencies",
    )


def method() -> bs.CompressiveSensingMHE:
    """The moving window, with the number of forces as cost."""
    sizes = {"q": SIGMA_Q, "v": SIGMA_V, "r": SIGMA_RATIO}
    prior = {f"{s}{i}": size for s, size in sizes.items() for i in MODES}
    return bs.CompressiveSensingMHE(
        noise=bs.Noise(sigma_y=NOISE),
        prior=bs.Prior(sigma_x0=prior),
        forces=FORCES,
        lam=20.0,
        N=14,
        sigma_force=0.005,
        threshold=1.0,
        refinement=bs.forces.Exchanges(),
    )


def known(scenarios: list[Scenario]) -> Known:
    """Bounds and errors of some recordings."""
    model, estimator = joint(), method()
    ratio = np.array(frequencies(THICKNESS[0.0])) / np.array(frequencies(THICKNESS[-10.0]))
    bounds, errors, scores = [], [], []
    for one in scenarios:
        found = bs.estimate(estimator, model, one.recording)
        last = found["x_hat"].values[-1, 6:]
        d = found["d_hat"].values[: len(one.d)]
        bounds.append(bound(one.d))
        errors.append((1 + last) / ratio - 1)
        scores.append(bs.forces.compare_forces(d, one.d[: len(d)], least=1.0).f1)
    return Known(np.array(bounds), np.array(errors), np.array(scores))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100)
    print(known([scenario(seed) for seed in range(parser.parse_args().recordings)]))
