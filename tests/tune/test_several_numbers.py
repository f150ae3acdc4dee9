"""Settings of several numbers: by name, or all of them by a factor."""

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import TuningError
from backsight.tune import Free, fit
from backsight.tune.fitting.values import placed, unknowns_of
from tune import noisy_motion

MODEL = bs.sdof(k=100.0, b=0.5)
PRIOR = bs.Prior(sigma_x0=0.1)
NOISE = bs.Noise(sigma_y=noisy_motion.SIGMA_Y, sigma_w=noisy_motion.SIGMA_W)


def steady_poles():
    """Eigenvalues of the error of the steady Kalman filter, by the Riccati equation of SciPy."""
    A, _ = noisy_motion.discrete()
    C, Q = np.array([[1.0, 0.0]]), np.diag(np.square(list(noisy_motion.SIGMA_W.values())))
    P = scipy.linalg.solve_discrete_are(A.T, C.T, Q, [[noisy_motion.SIGMA_Y**2]])
    K = A @ P @ C.T / (C @ P @ C.T + noisy_motion.SIGMA_Y**2)
    return np.linalg.eigvals(A - K @ C)


def test_poles_that_predict_best_are_those_of_the_kalman_filter():
    recording, best = noisy_motion.oscillation(500, seed=3), steady_poles()
    fast = bs.Luenberger(NOISE, PRIOR, poles=tuple(map(complex, best**2)))
    tuned = fit(fast, MODEL, recording, free=["poles"], check=False)
    assert tuned.values["poles"] == pytest.approx(0.5, abs=3 * tuned.std["poles"])
    assert tuned.std["poles"] < 0.06
    found = np.array(tuned.estimator.poles)
    np.testing.assert_allclose(found, best, atol=0.05)
    assert found[0] == found[1].conjugate()


def test_a_factor_changes_all_of_an_array():
    ahg = bs.AHG(bs.Noise(sigma_y=1e-3), PRIOR, gain=20.0, Gamma=np.diag([1e2, 1e1]))
    joint = bs.augment(MODEL, ["k", "b"])
    unknowns = unknowns_of([Free("Gamma")], ahg, joint)
    assert [(u.name, u.start) for u in unknowns] == [("Gamma", 1.0)]
    changed, _ = placed(ahg, joint, unknowns, {"Gamma": 3.0})
    np.testing.assert_array_equal(changed.Gamma, 3 * ahg.Gamma)


def test_numbers_by_name_are_free_together_and_alone():
    sensors = {"tip": ("displacement", [1.0]), "mid": ("displacement", [0.6])}
    rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces={"a": [1.0], "b": [0.4]})
    finder = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=1e-5), forces=("a", "b"), lam=15.0,
        sigma_force={"a": 0.1, "b": 0.3},
    )  # fmt: skip
    every = unknowns_of([Free("sigma_force")], finder, rod)
    assert {u.name: u.start for u in every} == {"sigma_force.a": 0.1, "sigma_force.b": 0.3}
    alone = unknowns_of([Free("sigma_force.b")], finder, rod)
    changed, _ = placed(finder, rod, alone, {"sigma_force.b": 0.7})
    assert changed.sigma_force == {"a": 0.1, "b": 0.7}


@pytest.mark.parametrize(
    ("estimator", "name", "message"),
    [
        (bs.HGO(NOISE, PRIOR, gain=20.0), "poles", "free gain"),
        (bs.Luenberger(NOISE, PRIOR, poles=(-0.2, 0.5)), "poles", "the pole -0.2 changes its sign"),
        (bs.Luenberger(NOISE, PRIOR, poles=(0.2, 0.5)), "poles.1", "did you mean 'poles'"),
    ],
)
def test_what_cannot_be_free_says_why(estimator, name, message):
    with pytest.raises(TuningError, match=message):
        unknowns_of([Free(name)], estimator, MODEL)


def test_search_ends_at_an_edge_of_the_criterion():
    """A delay of nothing: between samples the input is interpolated, which has an edge there."""
    recording = noisy_motion.oscillation(300, seed=5)
    found = fit(
        bs.EKF(NOISE, PRIOR), MODEL, recording, free=[Free("delay.u", sigma=0.01)],
        check=False, restarts=0,
    )  # fmt: skip
    assert found.converged
    assert abs(found.values["delay.u"]) < 2e-3
