"""Hits that are announced: as a stream would, and no more false ones than are accepted."""

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.errors import DataError


def result(d, std, dt=0.1):
    names = [f"F{i}" for i in range(np.shape(d)[1])]
    held = {"d_hat": (("time", "force"), d), "d_std": (("time", "force"), std)}
    return xr.Dataset(held, {"time": dt * np.arange(len(d)), "force": names}, {"dt": dt})


def test_they_are_those_that_neighbouring_steps_make():
    d = np.zeros((30, 3))
    d[[4, 5, 7], 0] = 5.0, 8.0, 4.0
    d[20, 2] = -9.0
    found = result(d, np.where(d != 0, 0.5, 0.0))
    announced = bs.forces.announce_hits(found)
    joined = bs.forces.find_impacts(found)
    assert [h.place for h in announced] == [h.place for h in joined]
    np.testing.assert_allclose([h.time for h in announced], [h.time for h in joined])
    np.testing.assert_allclose([h.impulse for h in announced], [h.impulse for h in joined])
    np.testing.assert_allclose([h.impulse_std for h in announced], [h.std for h in joined])
    assert [round(h.told, 9) for h in announced] == [0.9, 2.2]
    assert all(h.false_alarm < 1e-12 and h.time_std >= 0.1 / 12**0.5 for h in announced)


def test_noise_makes_no_more_of_them_than_are_accepted():
    """Half an hour of forces that are noise, four places at once."""
    d = np.random.default_rng(1).standard_normal((20_000, 4))
    counts = [
        len(bs.forces.announce_hits(result(d, np.ones_like(d)), per_hour=k, ghost=0.0))
        for k in (5.0, 40.0)
    ]
    assert counts[0] <= 5 + 3 * 5**0.5
    expected = 40 * 2000 / 3600
    assert 0.4 * expected <= counts[1] <= expected + 3 * expected**0.5


def test_what_another_place_explains_is_none():
    d = np.zeros((12, 2))
    d[3:5, 0], d[4, 1] = 8.0, 2.0
    found = result(d, np.where(d != 0, 0.1, 0.0))
    assert [h.place for h in bs.forces.announce_hits(found)] == ["F0"]
    assert [h.place for h in bs.forces.announce_hits(found, ghost=0.0)] == ["F0", "F1"]


def test_a_hit_at_the_end_is_told_with_the_last_row():
    d = np.zeros((6, 1))
    d[5] = 3.0
    (hit,) = bs.forces.announce_hits(result(d, np.full((6, 1), 0.1)))
    assert hit.told == pytest.approx(0.5)


def test_without_deviations_nothing_can_be_said():
    found = result(np.ones((3, 1)), np.ones((3, 1))).drop_vars("d_std")
    with pytest.raises(DataError, match="d_std"):
        bs.forces.announce_hits(found)
