"""Ground that moves: sensors feel it or not, supports move together or each by itself."""

import numpy as np
import pytest
from tests.models.finite_elements import at, beam_matrices, response

from backsight.errors import ModelError
from backsight.models.structures import reduced


@pytest.mark.parametrize("supports", ["all", "fixed"])
def test_ground_motion(supports):
    """A frame on ground that shakes: relative and absolute acceleration, by the whole structure."""
    n = 4
    K = 1e3 * (2 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1))
    K[0, 0] = K[n, n] = 1e3
    M, C = np.diag([5.0, 1, 1, 1, 2]), 2e-3 * K
    sensors = {
        "rel": ("relative_acceleration", n),
        "abs": ("absolute_acceleration", n),
        "y": ("displacement", n),
    }
    given = {"sensors": sensors, "ground": {"ag": "UX"}}
    if supports == "fixed":
        names = [f"{i}:UX" for i in range(n + 1)]
        model = reduced(M, K, modes=n, damping_matrix=C, fixed=["0:UX"], coordinates=names, **given)
    else:
        part = slice(1, None)
        names = [f"{i}:UX" for i in range(1, n + 1)]
        sensors |= {k: (kind, n - 1) for k, (kind, _) in sensors.items()}
        model = reduced(
            M[part, part], K[part, part], modes=n, damping_matrix=C[part, part],
            coordinates=names, **given,
        )  # fmt: skip
    assert [s.unit for s in model.inputs] == ["m/s2"]
    for s in (0.5j, 20j, 60j):
        m, k = M[1:, 1:], K[1:, 1:]
        relative = -response(m, 2e-3 * k, k, s) @ m @ np.ones(n)
        expected = [s * s * relative[-1], s * s * relative[-1] + 1, relative[-1]]
        np.testing.assert_allclose(at(model, s).ravel(), expected, rtol=1e-8)


def test_supports_that_move_differently():
    """A beam on two supports of which one goes up slowly: half of it in the middle."""
    M, K = beam_matrices(20, free=True)
    model = reduced(
        M, K, modes=3, damping=0.01, fixed=[0, 40], ground={"left": 0, "right": 40},
        sensors={"a": ("absolute_acceleration", 20)},
    )  # fmt: skip
    np.testing.assert_allclose(at(model, 0.01j), [[0.5, 0.5]], rtol=1e-4)
    with pytest.raises(ModelError, match="the ground moves no fixed coordinate"):
        reduced(
            M, K, modes=3, damping=0.01, fixed=[0, 40], ground={"left": 3},
            sensors={"a": ("absolute_acceleration", 20)},
        )  # fmt: skip
    with pytest.raises(ModelError, match="say absolute_acceleration"):
        reduced(
            M, K, modes=3, damping=0.01, fixed=[0, 40], ground={"left": 0},
            sensors={"a": ("acceleration", 20)},
        )  # fmt: skip
