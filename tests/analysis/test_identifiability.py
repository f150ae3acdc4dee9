"""Parameters that an unknown force can explain: said before and after a run, and only then."""

import functools

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import backsight as bs
from backsight.analysis.observability import flat_directions
from backsight.models.signals import Signal
from backsight.run.diagnosis._free_forces import constants_and_forces
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis._walks import tried

SAMPLES, WALK, SIGMA = 400, 0.02, 0.1
PRIOR = {"q": 1.0, "c": 2.0, "D": 0.5}


def gain_beside_drift() -> bs.Model:
    """``y = c u + D``, beside a state that has nothing to do with it."""
    plain = bs.from_equations(
        states={"q": "m"},
        inputs={"u": "V"},
        outputs={"y": "V"},
        parameters={"c": 1.0, "D": 0.0},
        equations={"q": "-q"},
        output_equations={"y": "c*u + D"},
    )
    return bs.augment(plain, ["c", "D"])


@functools.cache
def drifting() -> tuple[np.ndarray, np.ndarray]:
    """A slow input and the output of a gain of 1.5 with a drift."""
    rng = np.random.default_rng(3)
    u = np.sin(0.01 * np.arange(SAMPLES)) + 0.1 * rng.standard_normal(SAMPLES)
    drift = np.cumsum(WALK * rng.standard_normal(SAMPLES))
    return u, 1.5 * u + drift + SIGMA * rng.standard_normal(SAMPLES)


def judged(walk: float = WALK) -> tuple[bs.EKF, bs.Model, object]:
    u, y = drifting()
    noise = bs.Noise(sigma_y=SIGMA, sigma_w={"D": walk})
    recording = bs.from_arrays(u=u, y=y, dt=0.01, inputs={"u": "V"}, outputs={"y": "V"})
    return bs.EKF(noise, bs.Prior(sigma_x0=PRIOR)), gain_beside_drift(), recording


def dense(walk: float) -> tuple[float, float, float]:
    """Mean and deviation of c and log-likelihood by the joint normal density of all samples."""
    u, y = drifting()
    k = np.arange(SAMPLES)
    drift = PRIOR["D"] ** 2 + walk**2 * np.minimum.outer(k, k)
    other = drift + SIGMA**2 * np.eye(SAMPLES)
    S = other + PRIOR["c"] ** 2 * np.outer(u, u)
    gain = PRIOR["c"] ** 2 * np.linalg.solve(S, u)
    likelihood = multivariate_normal(u, S).logpdf(y)
    variance = PRIOR["c"] ** 2 * (1 - gain @ u)
    return 1.0 + gain @ (y - u), float(np.sqrt(variance)), likelihood


def test_expected_bands_are_those_of_the_normal_density_of_all_samples():
    (c,) = bs.check.check_identifiability(*judged()).parameters
    assert (c.name, c.prior) == ("c", 2.0)
    assert c.std == pytest.approx(dense(WALK)[1], rel=1e-9)
    assert c.without == pytest.approx(dense(0.0)[1], rel=1e-9)
    assert c.wider == pytest.approx(dense(3 * WALK)[1], rel=1e-9)


def trials(*walk):
    judge, *rest = judged(*walk)
    return tried(judge, Judges(*rest, {}, {}))


def test_trials_are_those_of_the_normal_density_of_all_samples():
    found = trials()
    assert found.parameters == ("c",)
    assert found.forces == ("D",)
    assert {t.factor for t in found.others} == {1 / 3, 3}
    for trial in (found.assumed, *found.others):
        x, std, likelihood = dense(WALK * trial.factor)
        assert trial.x[0] == pytest.approx(x, rel=1e-9)
        assert trial.std[0] == pytest.approx(std, rel=1e-9)
        assert trial.log_likelihood == pytest.approx(likelihood, rel=1e-9)


def test_likelihood_is_followed_to_the_walk_that_made_the_drift():
    found = trials(WALK / 30)
    best = found.possible[0]
    assert 9 <= best.factor <= 81
    assert best.log_likelihood == pytest.approx(dense(WALK / 30 * best.factor)[2], rel=1e-9)


def drive() -> bs.Model:
    """A carriage with friction and a force that nobody knows."""
    plain = bs.from_equations(
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"M": 70.0, "Fv": 100.0, "Fc": 10.0, "D": 0.0},
        equations={"q": "v", "v": "(F - Fv*v - Fc*tanh(v/1e-2) + D) / M"},
        output_equations={"y": "q"},
    )
    return bs.augment(plain, ["M", "Fv", "Fc", "D"])


@functools.cache
def driven(walk: float) -> object:
    """900 samples of a carriage of 95 kg, by Heun's method with ten steps per sample."""
    rng, dt, n = np.random.default_rng(0), 4e-3, 900
    t = dt * np.arange(n)
    F = 60 * np.sign(np.sin(3.1 * t)) + 40 * np.sin(2 * np.pi * (0.3 * t + 0.1 * t**2))
    D = np.cumsum(walk * rng.standard_normal(n))

    def slope(v: float, force: float) -> float:
        return (force - 203 * v - 20 * np.tanh(v / 1e-2)) / 95

    q, v, place = 0.0, 0.0, []
    for force in F + D:
        place.append(q)
        for _ in range(10):
            ahead = v + dt / 10 * slope(v, force)
            change = dt / 20 * (slope(v, force) + slope(ahead, force))
            q, v = q + dt / 20 * (2 * v + change), v + change
    y = np.array(place) + 3e-6 * rng.standard_normal(n)
    return bs.from_arrays(u=F, y=y, dt=dt, inputs={"F": "N"}, outputs={"y": "m"})


def believing(walk: float) -> bs.EKF:
    prior = {"q": 0.01, "v": 0.1, "M": 30.0, "Fv": 100.0, "Fc": 10.0, "D": 5.0}
    noise = bs.Noise(sigma_y=3e-6, sigma_w={"v": 1e-5, "D": walk})
    return bs.EKF(noise, bs.Prior(sigma_x0=prior))


def test_mass_that_a_wide_walk_can_explain_is_said_before_and_after():
    before = bs.check.check_identifiability(believing(20.0), drive(), driven(0.0))
    assert not before.sound
    assert "M" in {p.name for p in before.parameters if p.explained}
    assert "D can explain nearly all that tells M" in str(before)
    compared = bs.compare({"EKF": believing(20.0)}, drive(), driven(0.0))
    mass = compared["EKF"].x_hat[-1].sel(state="M").item()
    band = compared["EKF"].x_std[-1].sel(state="M").item()
    assert abs(mass - 95) > 3 * band
    (verdict,) = compared.verdicts()[-1:]
    assert "M cannot be told from D: with a walk about" in verdict
    assert "times smaller, which the innovations favour by" in verdict
    assert "measure D" in verdict


@pytest.mark.parametrize("walk", [0.3, 2.0])
def test_right_walk_raises_no_doubt(walk):
    result = bs.compare({"EKF": believing(walk)}, drive(), driven(walk))["EKF"]
    last = result.isel(time=-1).sel(state="M")
    assert abs(last.x_hat.item() - 95) < 3 * last.x_std.item()
    assert "cannot be told" not in result.attrs.get("doubts", "")


def test_states_are_told_apart_by_what_moves_them():
    noise = bs.Noise(sigma_y=1.0, sigma_w={"v": 1e-5, "D": 1.0})

    def names(model: bs.Model, assumed: bs.Noise) -> tuple[list[str], list[str]]:
        places = constants_and_forces(model, assumed)
        constants, forces = ([model.states[i].name for i in of] for of in places)
        return constants, forces

    assert names(drive(), noise) == (["M", "Fv", "Fc"], ["D"])
    swing = bs.from_equations(
        states={"q": "rad", "v": "rad/s", "d": "rad/s2", "e": "rad/s3"},
        outputs={"y": "rad"},
        parameters={"k": 1.0},
        equations={"q": "v", "v": "d - k*sin(q)", "d": "e - d", "e": "-e"},
        output_equations={"y": "q"},
    )
    every = bs.Noise(sigma_y=1.0, sigma_w={"q": 1.0, "v": 1.0, "e": 1.0})
    assert names(bs.augment(swing, ["k"]), every) == (["k"], ["e"])


def test_combination_that_is_not_shown_is_named():
    # The sum of b and c is known, their difference is not; d is known no better than before.
    P = np.zeros((4, 4))
    P[0, 0], P[3, 3] = 0.01, 0.9
    P[1:3, 1:3] = [[0.5001, -0.4999], [-0.4999, 0.5001]]
    signals = [Signal(name=n) for n in "abcd"]
    size = np.array([1.0, 2.0, 4.0, 3.0])
    sentences = flat_directions(P * np.outer(size, size), size, signals)
    assert sentences == (
        "the recording hardly shows a change of b and c in the ratio 1 : -2: only another "
        "combination is known",
        "the recording says hardly more of d than the prior does (± 2.8 after ± 3.0)",
    )
    assert flat_directions(1e-4 * np.eye(4), size, signals) == ()
