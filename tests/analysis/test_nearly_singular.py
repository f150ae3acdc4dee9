"""Innovations that are correlated to the last bit."""

import numpy as np

import backsight as bs


def test_they_are_left_out():
    model = bs.lti(
        [[0.5]], np.zeros((1, 0)), [[1], [1]], states={"q": "m"}, inputs={},
        outputs={"a": "m", "b": "m"}, dt=1.0,
    )  # fmt: skip
    recording = bs.from_arrays(
        y=np.zeros((30, 2)), dt=1.0, inputs={}, outputs={"a": "m", "b": "m"}
    )  # fmt: skip
    e = bs.KalmanFilter(bs.Noise(sigma_y=1.0, sigma_w=0.1), bs.Prior(sigma_x0=1.0))
    result = bs.estimate(e, model, recording, engine="vm")
    S = result.S.values.copy()
    S[0] = [
        [1.6126817009679754e58, 8.394817627623489e136],
        [8.394817627623489e136, 4.369923895010298e215],
    ]
    result["S"] = (result.S.dims, S)
    assert np.isnan(bs.check.nis(result).values[0])
    assert np.isfinite(bs.check.nis(result).values[1:]).all()
    assert "mean" in str(bs.check.check_consistency(result))
