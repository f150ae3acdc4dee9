"""Descriptions that say the same are alike, with arrays in them too."""

import numpy as np
import pytest

import backsight as bs
from backsight.description import alike
from backsight.settings import ConstantArrival, NoArrival

R = np.array([[1.0, 0.2], [0.2, 1.0]])
PRIOR = bs.Prior({"a": 1.0, "b": 2.0})


def mhe(**settings):
    return bs.MHE(**({"noise": bs.Noise(R=R), "prior": PRIOR} | settings))


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (mhe(noise=bs.Noise(R=R.copy())), True),
        (mhe(noise=bs.Noise(R=2 * R)), False),
        (mhe(noise=bs.Noise(sigma_y=1.0)), False),
        (mhe(prior=bs.Prior({"a": 1.0, "b": 2.0})), True),
        (mhe(prior=bs.Prior({"a": 1.0, "b": 3.0})), False),
        (mhe(prior=bs.Prior([1.0, 2.0])), False),
        (mhe(constant=("a",)), False),
        (mhe(arrival=NoArrival()), False),
        (bs.EKF(bs.Noise(R=R), PRIOR), False),
    ],
)
def test_alike(other, same):
    assert alike(mhe(), other) == same


def test_an_arrival_cost_with_a_matrix_is_none_of_the_others():
    own, *others = mhe(arrival=ConstantArrival(R)).variants().values()
    assert own.arrival.P is not None
    assert len(others) == 6
