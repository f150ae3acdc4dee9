"""A filter that begins with wrong parameters follows late: that is no delay of the recording."""

import numpy as np
import pytest

import backsight as bs


def heater(C, h, **told):
    return bs.Model(
        f=lambda x, u, p: [(u.P - p.h * x.T) / p.C],
        h=lambda x, _u, _p: [x.T],
        states={"T": "K"},
        inputs={"P": "W"},
        outputs={"y": "K"},
        parameters={"C": bs.Signal("J/K", value=C, **told), "h": bs.Signal("W/K", value=h)},
    )


@pytest.mark.parametrize(
    ("told", "start", "late"),
    [
        ({}, (50.0, 2.0), 0),  # the estimate of C ends below zero
        ({"lower": 1.0}, (50.0, 2.0), 0),
        ({"positive": True}, (350.0, 7.0), 2),
        ({"lower": 1.0}, (350.0, 7.0), 2),
    ],
)
def test_other_parameters_explain_a_recording_without_a_delay(told, start, late):
    power = [[40.0 * (k // 60 % 2)] for k in range(400)]
    data = bs.simulate(heater(400.0, 8.0), power, dt=0.5, sigma_y=0.05, seed=1)
    data["y"] = data["y"].dims, np.roll(data["y"].values, late, axis=0)
    prior = bs.Prior(sigma_x0={"T": 1.0, "C": 100.0, "h": 5.0})
    judge = bs.EKF(bs.Noise(sigma_y=0.05, sigma_w={"T": 1e-3}), prior)
    result = bs.check.check_alignment(judge, bs.augment(heater(*start, **told), ["C", "h"]), data)
    assert result.delay == late
    assert result.explained == (late == 0)
    assert ("other parameters explain" in str(result)) == (late == 0)
