"""Size and time scale of the processes that forces follow, as free values."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.errors import ModelError, TuningError
from backsight.models.forces.changing import with_process

DT = 0.05


def pole(dt: float | None = None) -> bs.Model:
    """A pole in the wind; of a discrete-time model the same by Euler's method."""
    step = 1.0 if dt is None else dt
    return bs.Model(
        f=lambda x, u, p: (
            [x.v, -90 * x.q - 0.6 * x.v + p.wind]
            if dt is None
            else [x.q + step * x.v, x.v + step * (-90 * x.q - 0.6 * x.v + p.wind)]
        ),
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"n": "Hz"},
        outputs={"y": "m"},
        parameters={"wind": (0.5, "N/kg")},
        dt=dt,
    )


@pytest.mark.parametrize("dt", [None, 1e-3])
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (bs.forces.GaussMarkov(1.0, 5.0), bs.forces.GaussMarkov(3.0, 0.8)),
        (bs.forces.Matern(1.0, 5.0, "5/2"), bs.forces.Matern(3.0, 0.8, "5/2")),
        (
            bs.forces.Periodic(1.0, "n", orders=(1.0, 2.0), memory=3.0),
            bs.forces.Periodic(2.0, "n", orders=(1.0, 2.0), memory=9.0),
        ),
    ],
)
def test_a_changed_process_is_that_of_a_model_built_anew(dt, before, after):
    changed = with_process(bs.augment(pole(dt), forces={"wind": before}), "wind", after)
    anew = bs.augment(pole(dt), forces={"wind": after})

    x, u = np.random.default_rng(0).standard_normal((2, changed.nx))
    for own, other in ((changed.f, anew.f), (changed.h, anew.h)):
        np.testing.assert_allclose(
            own(x, u[:1], ca.DM(0, 1)), other(x, u[:1], ca.DM(0, 1)), rtol=1e-14, atol=1e-14
        )
    for own, other in zip(changed.driven, anew.driven, strict=True):
        np.testing.assert_array_equal(own.noise, other.noise)
        np.testing.assert_array_equal(own.stationary, other.stationary)
        assert (own.states, own.says) == (other.states, other.says)


def test_a_process_of_other_states_is_refused():
    model = bs.augment(pole(), forces={"wind": bs.forces.GaussMarkov(1.0, 5.0)})

    with pytest.raises(ModelError, match="has the states wind, not of this process"):
        with_process(model, "wind", bs.forces.Matern(1.0, 1.0))
    with pytest.raises(ModelError, match="'gust' follows no process"):
        with_process(model, "gust", bs.forces.Matern(1.0, 1.0))


@pytest.fixture(scope="module")
def blown():
    """A recording in a wind of 3 N/kg that forgets after 0.8 s, exact in the sampled times."""
    import scipy

    A = np.array([[0, 1, 0], [-90, -0.6, 1], [0, 0, -1 / 0.8]])
    Qc = np.diag([0, 0, 2 * 9 / 0.8])
    big = scipy.linalg.expm(np.block([[-A, Qc], [np.zeros((3, 3)), A.T]]) * DT)
    Phi = big[3:, 3:].T
    root = np.linalg.cholesky(Phi @ big[:3, 3:] + 1e-15 * np.eye(3))
    rng = np.random.default_rng(3)
    x, measured = np.array([0, 0, 3.0]), []
    for _ in range(300):
        measured.append(x[0] + 1e-3 * rng.normal())
        x = Phi @ x + root @ rng.normal(size=3)
    return bs.from_arrays(
        u=np.zeros(300), y=measured, dt=DT, inputs={"n": "Hz"}, outputs={"y": "m"}
    )


KF = bs.KalmanFilter(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0={"q": 0.1, "v": 1.0}))


def test_size_and_scale_are_found_and_lie_at_the_top_of_the_likelihood(blown):
    model = bs.augment(pole(), forces={"wind": bs.forces.GaussMarkov(1.0, 3.0)})
    flat = bs.tune.Free("wind", spread=np.inf)

    tuned = bs.tune.fit(KF, model, blown, free=[flat], check=False)

    def likely(sigma, time):
        anew = bs.augment(pole(), forces={"wind": bs.forces.GaussMarkov(sigma, time)})
        result = bs.estimate(KF, anew, blown, engine="vm")
        return float(bs.check.log_likelihood(result).sum())

    found = tuned.values["wind.sigma"], tuned.values["wind.length"]
    top = likely(*found)
    for factors in ((1.1, 1.0), (0.9, 1.0), (1.0, 1.15), (1.0, 0.85)):
        assert likely(*np.multiply(found, factors)) < top
    for name, truth in (("wind.sigma", 3.0), ("wind.length", 0.8)):
        assert abs(tuned.values[name] - truth) < 3 * tuned.std[name]
    assert tuned.units == {"wind.sigma": "N/kg", "wind.length": "s"}
    assert tuned.model.driven[0].process == bs.forces.GaussMarkov(*found)


def test_names_that_no_process_has_are_refused(blown):
    model = bs.augment(pole(), forces={"wind": bs.forces.GaussMarkov(1.0, 3.0)})

    with pytest.raises(TuningError, match=r"'wind.memory' cannot be free: .*length"):
        bs.tune.fit(KF, model, blown, free=["wind.memory"])
    scaled = dataclasses.replace(
        model, driven=(dataclasses.replace(model.driven[0], process=None),)
    )
    with pytest.raises(TuningError, match=r"'wind.sigma' cannot be free"):
        bs.tune.fit(KF, scaled, blown, free=["wind.sigma"])
