import math

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError


def forces(entries: dict) -> np.ndarray:
    d = np.zeros((20, 5))
    for place, value in entries.items():
        d[place] = value
    return d


TRUE = forces({(3, 1): 4.0, (9, 2): -5.0, (15, 4): 10.0})


def test_counts_and_scores():
    found = forces({(3, 1): 3.0, (9, 3): -4.0, (15, 4): 11.0, (18, 0): 1.0})
    e = bs.forces.compare_forces(found, TRUE)
    assert (e.hits, e.missed, e.false_alarms) == (2, 1, 2)
    assert (e.precision, e.recall) == (0.5, pytest.approx(2 / 3))
    assert e.f1 == pytest.approx(2 * 0.5 * (2 / 3) / (0.5 + 2 / 3))
    assert e.magnitude == pytest.approx((0.25 + 0.1) / 2)
    assert not e.exact
    near = bs.forces.compare_forces(found, TRUE, places=1, least=2.0)
    assert near.exact
    assert near.f1 == 1.0
    assert near.pairs == (((3, 1), (3, 1)), ((9, 2), (9, 3)), ((15, 4), (15, 4)))


def test_each_force_is_used_once_and_the_closest_wins():
    found = forces({(2, 1): 9.0, (3, 1): 1.0, (4, 1): 1.0})
    e = bs.forces.compare_forces(found, TRUE, steps=1)
    assert e.pairs == (((3, 1), (3, 1)),)
    assert e.false_alarms == 2
    crowded = forces({(5, 1): 2.0, (7, 1): 2.0})
    one = bs.forces.compare_forces(forces({(6, 1): 2.0}), crowded, steps=1)
    assert (one.hits, one.missed, one.false_alarms) == (1, 1, 0)
    twice = forces({(3, 0): 1.0, (3, 2): 3.0})
    assert bs.forces.compare_forces(twice, TRUE, places=1).pairs == (((3, 1), (3, 2)),)


def test_the_direction_counts():
    assert bs.forces.compare_forces(-TRUE, TRUE).hits == 0


def test_nothing_found_and_nothing_there():
    nothing = np.zeros((20, 5))
    missed = bs.forces.compare_forces(nothing, TRUE)
    assert (missed.f1, missed.recall, missed.precision) == (0.0, 0.0, 1.0)
    assert math.isnan(missed.magnitude)
    assert bs.forces.compare_forces(nothing, nothing).exact
    assert bs.forces.compare_forces(nothing, nothing).f1 == 1.0
    assert bs.forces.compare_forces(np.full((20, 5), np.nan), TRUE).false_alarms == 0


def test_bad_input_is_refused():
    with pytest.raises(DataError, match="shape"):
        bs.forces.compare_forces(TRUE[:3], TRUE)
    with pytest.raises(DataError, match="negative"):
        bs.forces.compare_forces(TRUE, TRUE, steps=-1)
