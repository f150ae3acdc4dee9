"""A stream is saved, restored, reset and pickled without a difference in any bit."""

import pickle

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError

PLANT = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k"])
RNG = np.random.default_rng(0)
U, Y = RNG.normal(size=(60, 1)), RNG.normal(size=(60, 1))


def started(engine="vm"):
    ekf = bs.EKF(bs.Noise(sigma_y=0.1, sigma_w={"v": 0.1}), bs.Prior(sigma_x0=1.0))
    return bs.stream(ekf, PLANT, dt=0.01, engine=engine)


def run(live, start, end):
    return np.array([live.step(U[k], Y[k])["x_hat"] for k in range(start, end)])


@pytest.mark.parametrize("engine", ["vm", "native"])
def test_whole_is_first_half_and_second_half(engine):
    whole = run(started(engine), 0, 60)
    live = started(engine)
    first = run(live, 0, 30)
    memory = live.save()
    other, copy = started(engine), pickle.loads(pickle.dumps(live))
    other.restore(memory)
    for going_on in (live, other, copy):
        np.testing.assert_array_equal(np.vstack([first, run(going_on, 30, 60)]), whole)
    live.reset()
    np.testing.assert_array_equal(run(live, 0, 60), whole)
    # What was saved is a copy: the stream went on without changing it.
    other.restore(memory)
    np.testing.assert_array_equal(run(other, 30, 60), whole[30:])


def test_values_by_name():
    live = started()
    sample = live.step(U[0], Y[0])
    assert live.named(sample) == dict(zip(("q", "v", "k"), sample["x_hat"], strict=True))
    assert live.named(sample, "y_hat") == {"y": float(sample["y_hat"][0])}
    with pytest.raises(DataError, match="no 'x_hut' by name, did you mean 'x_hat'"):
        live.named(sample, "x_hut")


def test_a_memory_of_another_make_is_refused():
    with pytest.raises(DataError, match="not from this stream"):
        started().restore(np.zeros(3))
