import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.errors import DataError, ModelError, TuningError
from backsight.estimators import AHG, Noise, Prior
from backsight.models.augment import augment
from backsight.models.canonical.affine import affine_form
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import estimate
from backsight.run.simulation import simulate
from backsight.tune import propose_gain, propose_gamma

DT, LAM = 0.01, 25.0
K, B = 90.0, 4.0


def plant() -> Model:
    return Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "m/s2"},
        outputs={"y": "m"},
        parameters={"k": Signal("1/s2", K), "b": Signal("1/s", B)},
    )


def joint() -> Model:
    return augment(plant(), ["k", "b"])


@pytest.fixture(scope="module")
def motion():
    t = np.arange(1200) * DT
    force = 20 * (np.sin(4.0 * t) + np.sin(11.0 * t) + np.sin(19.0 * t))
    return simulate(plant(), force, dt=DT)


def mean_square_of_upsilon(motion):
    """Equation 8 by an adaptive solver, from 4 s on; the columns are k and b, relative."""
    x, time = motion["x_true"].values, motion["time"].values
    theta = np.array([K, B])

    def rhs(t, U):
        U = U.reshape(2, 2)
        state = [np.interp(t, time, x[:, i]) for i in range(2)]
        psi = -np.array(state) * theta
        return (LAM * np.array([U[1] - 2 * U[0], -U[0] + psi])).ravel()

    late = time[time >= 4.0]
    solution = solve_ivp(
        rhs, (0, time[-1]), np.zeros(4), t_eval=late, rtol=1e-7, atol=1e-9, max_step=DT
    )
    U = solution.y[:2].T
    return U.T @ U / len(U)


def test_gamma_is_its_definition(motion):
    """Gamma = g Theta inv(M) Theta, with the mean over whole periods of 2 pi."""
    M = mean_square_of_upsilon(motion)
    theta = np.array([K, B])
    full = propose_gamma(joint(), motion, gain=LAM, rate=3.0)
    diagonal = propose_gamma(joint(), motion, gain=LAM, rate=3.0, diagonal=True)
    assert affine_form(joint()).combinations == ("k", "b")
    size = np.sqrt(np.diag(full))
    expected = 3.0 * np.outer(theta, theta) * np.linalg.inv(M)
    np.testing.assert_allclose(full / np.outer(size, size), expected / np.outer(size, size),
                               atol=0.05)  # fmt: skip
    np.testing.assert_allclose(np.diag(diagonal), 3.0 * theta**2 / np.diag(M), rtol=0.05)
    assert diagonal[0, 1] == 0
    assert np.linalg.eigvalsh(full / np.outer(size, size)).min() > 0


def test_all_parameters_converge_at_the_given_rate(motion):
    """The error of each falls by e^-1 in 1 / g, whichever parameter is wrong."""
    rate = 0.8
    Gamma = propose_gamma(joint(), motion, gain=LAM, rate=rate)
    for wrong in ("k", "b"):
        start = {"k": K, "b": B} | {wrong: 1.15 * {"k": K, "b": B}[wrong]}
        observer = AHG(Noise(sigma_y=1e-4), Prior(x0=start, sigma_x0=1.0), gain=LAM, Gamma=Gamma)
        x = estimate(observer, joint(), motion)["x_hat"].sel(state=wrong).values
        error = x / {"k": K, "b": B}[wrong] - 1
        half_time, end = np.mean(error[300:400]), np.mean(error[800:900])
        found = np.log(half_time / end) / 5.0
        assert found == pytest.approx(rate, rel=0.25)


def test_whole_periods(motion):
    """A motion that repeats gives the same Gamma, wherever it is cut."""
    t = np.arange(2000) * DT
    periodic = simulate(plant(), 20 * (np.sin(5 * np.pi * t) + np.sin(2 * np.pi * t)), dt=DT)
    late = periodic.isel(time=slice(600, None))
    full = [
        propose_gamma(joint(), late.isel(time=slice(0, n)), gain=LAM, period=2.0)
        for n in (650, 1010, 1385)
    ]
    size = np.outer(*[np.sqrt(np.diag(full[0]))] * 2)
    for other in full[1:]:
        np.testing.assert_allclose(other / size, full[0] / size, rtol=0, atol=1e-4)


def test_results_are_motions_too(motion):
    observer = AHG(Noise(sigma_y=1e-4), Prior(sigma_x0=0.1), gain=LAM, Gamma=np.array([10.0, 0.1]))
    result = estimate(observer, joint(), motion)
    from_truth = propose_gamma(joint(), motion, gain=LAM)
    from_result = propose_gamma(joint(), result, gain=LAM)
    size = np.sqrt(np.diag(from_truth))
    np.testing.assert_allclose(
        from_result / np.outer(size, size), from_truth / np.outer(size, size), atol=0.02
    )


def test_lambda_follows_the_faster_of_model_and_motion():
    """2.5 times the natural frequency in slow motion, and with fast motion its frequency."""
    t = np.arange(4000) * 1e-3
    slow = simulate(plant(), 20 * np.sin(1.0 * t), dt=1e-3)
    assert propose_gain(joint(), slow) == pytest.approx(2.5 * np.sqrt(K), rel=1e-3)
    fast = simulate(plant(), 1e4 * np.sin(200.0 * t), dt=1e-3).isel(time=slice(2500, None))
    assert propose_gain(joint(), fast) == pytest.approx(2.5 * 200.0, rel=0.02)
    assert propose_gain(joint(), slow, factor=1.0) == pytest.approx(np.sqrt(K), rel=1e-3)


def test_a_motion_that_does_not_excite():
    rest = simulate(plant(), np.zeros(400), dt=DT)
    with pytest.raises(TuningError, match="does not excite k, b"):
        propose_gamma(joint(), rest, gain=LAM)
    with pytest.raises(TuningError, match="at rest: 'v' does not change"):
        propose_gain(joint(), rest)
    # In free motion that only decays, displacement and speed are the same function.
    decaying = simulate(
        plant(), np.zeros(400), dt=DT, parameters={"k": 3.0, "b": 4.0}, x0={"q": 1.0, "v": -1.0}
    )
    with pytest.raises(TuningError, match="k, b move the output alike"):
        propose_gamma(joint(), decaying.isel(time=slice(0, 300)), gain=LAM)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"gain": 0.0}, TuningError, "gain is 0.0"),
        ({"rate": -1.0}, TuningError, "rate is -1.0"),
        ({"hold": "none"}, TuningError, "unknown hold 'none'"),
        ({"poles": 1.0}, TuningError, "negative real part"),
        ({"gain": 0.01}, DataError, "1199 samples; 100000 are needed to settle"),
        ({"period": 1e3}, DataError, "100000 more"),
    ],
)
def test_wrong_settings(motion, settings, error, message):
    with pytest.raises(error, match=message):
        propose_gamma(joint(), motion, **({"gain": LAM} | settings))


def test_wrong_motions(motion):
    with pytest.raises(DataError, match="neither 'x_true' nor 'x_hat'"):
        propose_gamma(joint(), motion.drop_vars("x_true"), gain=LAM)
    with pytest.raises(DataError, match="no state v"):
        propose_gamma(joint(), motion.sel(state=["q", "k"]), gain=LAM)
    gap = motion["x_true"].copy()
    gap[5] = np.nan
    with pytest.raises(DataError, match="not finite"):
        propose_gamma(joint(), motion.assign(x_true=gap), gain=LAM)
    with pytest.raises(ModelError, match="canonical form"):
        propose_gain(
            Model(f=lambda x, u, p: [x.a], h=lambda x, u, p: [x.a], states={"a": ""},
                  inputs={"F": ""}, outputs={"y": ""}, dt=DT),
            motion,
        )  # fmt: skip


def test_nominal_values_must_not_be_zero(motion):
    free = augment(
        Model(
            f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F],
            h=lambda x, u, p: [x.q],
            states={"q": "m", "v": "m/s"},
            inputs={"F": "m/s2"},
            outputs={"y": "m"},
            parameters={"k": K, "b": 0.0},
        ),
        ["k", "b"],
    )
    with pytest.raises(TuningError, match="none of them may be zero"):
        propose_gamma(free, motion, gain=LAM)
