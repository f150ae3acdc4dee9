"""How sure a fit is: against many recordings of a drive with a flexible shaft."""

import numpy as np
import pytest

import backsight as bs
from backsight.tune import Free, fit

SIGMA_Y = {"motor": 1e-3, "load": 3e-3}
SIGMA_W = {"w1": 0.03, "w2": 0.01}
PRIOR = bs.Prior(sigma_x0={"a1": 0.01, "w1": 0.1, "a2": 0.01, "w2": 0.1})
START = bs.EKF(
    bs.Noise(
        sigma_y={n: 3 * s for n, s in SIGMA_Y.items()},
        sigma_w={n: s / 3 for n, s in SIGMA_W.items()},
    ),
    PRIOR,
)


def drive(stiffness=60.0):
    """Motor and load on a shaft, an encoder on each."""
    return bs.Model(
        f=lambda x, u, p: [
            x.w1,
            -p.c * (x.a1 - x.a2) - 0.4 * x.w1 + u.M,
            x.w2,
            1.5 * p.c * (x.a1 - x.a2) - 0.6 * x.w2 - 5.0 * x.a2,
        ],
        h=lambda x, _u, _p: [x.a1, x.a2],
        states={"a1": "rad", "w1": "rad/s", "a2": "rad", "w2": "rad/s"},
        inputs={"M": "1/s2"},
        outputs={"motor": "rad", "load": "rad"},
        parameters={"c": stiffness},
    )


def recording(seed, samples=1000, stiffness=60.0):
    """A recording with process noise at every sample."""
    rng, dt = np.random.default_rng(seed), 0.02
    u = np.repeat(3 * rng.uniform(-1, 1, samples // 10), 10)[:, None]
    sigma = np.array([SIGMA_W.get(s.name, 0.0) for s in drive().states])
    A = np.array(
        [[0, 1, 0, 0], [-1, -0.4 / stiffness, 1, 0], [0, 0, 0, 1], [1.5, 0, -1.5, -0.6 / stiffness]]
    )
    A[1] *= stiffness
    A[3] *= stiffness
    A[3, 2] -= 5.0
    step = lambda x, m: A @ x + np.array([0, m, 0, 0])  # noqa: E731
    x, y = 0.01 * rng.standard_normal(4) * [1, 10, 1, 10], []
    for m in u[:, 0]:
        y.append(x[[0, 2]])
        for _ in range(4):  # Runge-Kutta, four steps
            h = dt / 4
            k1 = step(x, m)
            k2 = step(x + h / 2 * k1, m)
            k3 = step(x + h / 2 * k2, m)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + step(x + h * k3, m))
        x = x + sigma * rng.standard_normal(4)
    y = np.array(y) + rng.standard_normal((samples, 2)) * list(SIGMA_Y.values())
    return bs.from_arrays(
        dt=dt, u=u, y=y, inputs={"M": "1/s2"}, outputs={"motor": "rad", "load": "rad"}
    )


@pytest.mark.slow
def test_bands_and_correlations_are_those_of_many_recordings():
    true = {f"sigma_y.{n}": s for n, s in SIGMA_Y.items()}
    true |= {f"sigma_w.{n}": s for n, s in SIGMA_W.items()} | {"c": 60.0}
    errors, sizes, correlations = [], [], []
    for seed in range(100):
        tuned = fit(
            START, drive(), recording(seed), free=["sigma_y", "sigma_w", "c"], check=False,
            restarts=0,
        )  # fmt: skip
        assert tuned.converged
        logs = [np.log(tuned.values[n] / s) for n, s in true.items()]
        errors.append(logs)
        sizes.append([tuned.std[n] / tuned.values[n] for n in true])
        order = [list(tuned.values).index(n) for n in true]
        correlations.append(tuned.correlation.values[np.ix_(order, order)])
    errors, sizes = np.array(errors), np.array(sizes)
    covered = (np.abs(errors) <= 2 * sizes).mean(axis=0)
    # 95.4 of 100 on average, with a standard deviation of 2.1.
    assert (covered >= 0.89).all(), covered
    assert 0.93 <= covered.mean() <= 0.985, covered
    np.testing.assert_allclose(sizes.mean(axis=0), errors.std(axis=0), rtol=0.25)
    # Correlations of 100 errors are known to 0.1.
    off = np.corrcoef(errors.T) - np.mean(correlations, axis=0)
    assert np.abs(off).max() < 0.3


def test_groups_have_values_of_their_own():
    stiff = {"cold": 60.0, "warm": 45.0}
    groups = ("cold", "warm", "cold")
    several = [recording(k, 400, stiff[g]) for k, g in enumerate(groups)]
    tuned = fit(
        START, drive(55.0), several, check=False, restarts=0,
        free=["sigma_y", Free("c", per=groups), Free("sigma_w.w1", per="recording"), "sigma_w.w2"],
    )  # fmt: skip
    for group, value in stiff.items():
        assert abs(tuned.values[f"c[{group}]"] - value) < 4 * tuned.std[f"c[{group}]"]
        assert tuned.std[f"c[{group}]"] < 0.02 * value
    assert {f"sigma_w.w1[{k}]" for k in (1, 2, 3)} < set(tuned.values)
    parameter = [m.parameters[0].value for m in tuned.models]
    assert parameter[0] == parameter[2] == tuned.values["c[cold]"] != parameter[1]
    assert tuned.estimators[1].noise.sigma_w["w1"] == tuned.values["sigma_w.w1[2]"]


def test_a_flat_direction_and_a_bound_are_told():
    bounded = bs.Model(
        f=drive().f, h=drive().h, states=drive().states, inputs=drive().inputs,
        outputs=drive().outputs,
        parameters={"c": bs.Signal(value=50.0, lower=40.0, upper=55.0)},
    )  # fmt: skip
    # One start value tells next to nothing of the deviation of start values.
    tuned = fit(
        START, bounded, recording(7, 400), free=["sigma_y", "c", "sigma_x0.a2"], restarts=0,
    )  # fmt: skip
    assert any(d.startswith("c is at its bound") for d in tuned.doubts), tuned.doubts
    assert any("sigma_x0.a2 is hardly known" in d for d in tuned.doubts), tuned.doubts
