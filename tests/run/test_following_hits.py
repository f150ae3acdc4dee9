"""Hits through sensors at their limits: found by the equations themselves."""

import functools

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.run.following import carry_out_following, ready_to_follow

PLACES = {"A": (0.9, 0.2), "B": (0.5, -0.8)}
OMEGA, DAMPING, LIMIT, DT = (14.0, 47.0), 0.01, 6.0, 0.01
SHAPES = np.array([[1.0, 0.6], [0.7, -0.9]])


@functools.cache
def structure():
    """Two modes, two accelerometers with a limit, two places."""

    def acceleration(x, u, p):
        force = [PLACES["A"][i] * p.A + PLACES["B"][i] * p.B + 0.3 * p.M for i in range(2)]
        q, v = (x.q1, x.q2), (x.v1, x.v2)
        return [
            f - w**2 * a - 2 * DAMPING * w * b
            for f, w, a, b in zip(force, OMEGA, q, v, strict=True)
        ]

    def seen(x, u, p):
        a = acceleration(x, u, p)
        return [SHAPES[j][0] * a[0] + SHAPES[j][1] * a[1] for j in range(2)]

    plain = bs.Model(
        f=lambda x, u, p: [x.v1, x.v2, *acceleration(x, u, p)], h=seen,
        states=dict.fromkeys(("q1", "q2", "v1", "v2"), ""), inputs={},
        outputs={"a": "m/s2", "b": "m/s2"}, parameters=dict.fromkeys(("A", "B", "M"), (0.0, "N")),
    )  # fmt: skip
    sensor = bs.models.Sensor(limit=LIMIT)
    return bs.models.with_sensors(plain, {"a": sensor, "b": sensor})


def struck(*hits, samples=120, seed=1):
    """A recording with hits (force, start, width, height); half of the samples have one channel."""
    course, d = bs.forces.HalfSines((1,)), np.zeros((samples, 3))
    for force, start, width, height in hits:
        d[:, force] += height * course.means(np.arange(samples + 1.0), start=start, width=width)
    model = bs.forces.forces_as_inputs(structure(), ["A", "B", "M"])
    data = bs.simulate(model, d, dt=DT, sigma_y=0.02, seed=seed)
    values = data["y"].values.copy()
    values[1::2, 0] = np.nan
    outputs = {"a": "m/s2", "b": "m/s2"}
    return bs.from_arrays(y=values, dt=DT, inputs={}, outputs=outputs)


def method(**settings):
    given = {"sigma_force": 0.02, "dictionary": bs.forces.HalfSines((3, 5))}
    return bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=0.02), bs.Prior(sigma_x0=1e-2), forces=("A", "B", "M"), lam=1.0,
        **(given | settings)
    )  # fmt: skip


def follow(recording, made=None, **settings):
    given = {"sizes": (4.0, 60.0), "before": 25, "after": 40, "beside": ("M",)}
    return bs.forces.follow_hits(made or method(), structure(), recording, **(given | settings))


def test_hits_are_found_where_when_and_as_hard_as_they_were():
    """Four times beyond the limit, with a moment beside; bands hold all of it."""
    found = follow(struck((1, 40.3, 4.2, 40.0), (2, 40.3, 4.2, -9.0)))
    assert list(found["force"].values) == ["B"]
    true = {"start": 40.3 * DT, "width": 4.2 * DT, "size": 40.0}
    true["time"] = true["start"] + true["width"] / 2
    true["impulse"] = true["size"] * true["width"] * 2 / np.pi
    for name, value in true.items():
        off = abs(float(found[name][0]) - value)
        assert off <= 4 * float(found[f"{name}_std"][0]), name
        assert float(found[f"{name}_std"][0]) < 0.05 * value, name
    assert float(found["beside"].sel(moved="M")[0]) == pytest.approx(-9.0, rel=0.1)
    assert float(found["rival"][0]) > 3
    assert float(found["explained"][0]) > 0.9


def test_a_motion_without_hits_has_none():
    found = follow(struck())
    assert found.sizes["hit"] == 0
    assert found["beside"].shape == (0, 1)


def test_a_known_sign_is_kept():
    recording = struck((0, 40.0, 4.0, 30.0))
    assert list(follow(recording)["force"].values) == ["A"]
    pulled = follow(recording, method(nonpositive=("A", "B")))
    assert all(size <= 0 for size in pulled["size"].values)


def test_what_cannot_be_followed_is_refused():
    with pytest.raises(TuningError, match="beside: 'N' is none of the forces"):
        follow(struck(), beside=("N",))
    with pytest.raises(TuningError, match="leave one out"):
        follow(struck(), beside=("A", "B", "M"))
    with pytest.raises(TuningError, match="dictionary of pulses"):
        follow(struck(), method(dictionary=bs.forces.Atoms(np.eye(3))))


def test_between_hits_it_is_the_ekf_with_forces_as_noise():
    """Filter of the follower beside that of the library, in all it says of every sample."""
    recording = struck(samples=50)
    task = ready_to_follow(
        method(), structure(), recording,
        sizes=(4.0, 60.0), before=10, after=10, beside=(), alarm=100.0, gain=0.5,
    )  # fmt: skip
    followed = carry_out_following(task, progress=lambda _: None)
    noise = bs.Noise(sigma_y=0.02, sigma_p=dict.fromkeys("ABM", 0.02))
    told = bs.estimate(bs.EKF(noise, bs.Prior(sigma_x0=1e-2)), structure(), recording, engine="vm")
    for name in ("x_hat", "x_std", "e", "S"):
        size = np.nanmax(np.abs(told[name].values))
        np.testing.assert_allclose(followed[name], told[name], atol=1e-10 * size, err_msg=name)
