import numpy as np
import pytest
import xarray as xr

from backsight.analysis.forces import find_impacts, matches
from backsight.errors import DataError

DT = 0.01


def result_of(forces, std=None):
    """Forces {place: {step: value}} over 50 steps."""
    d_hat = np.zeros((50, len(forces)))
    for i, steps in enumerate(forces.values()):
        for k, value in steps.items():
            d_hat[k, i] = value
    found = xr.Dataset(
        {"d_hat": (("time", "force"), d_hat)},
        coords={"time": 1.0 + DT * np.arange(50), "force": list(forces)},
        attrs={"dt": DT},
    )
    return found if std is None else found.assign(d_std=std * (np.abs(found["d_hat"]) > 0))


def test_a_pulse_over_several_steps_is_one_hit():
    (hit,) = find_impacts(result_of({"low": {}, "high": {10: 1.0, 11: 2.0, 12: 1.0}}, std=0.3))
    assert hit.place == "high"
    assert hit.time == pytest.approx(1.115)
    assert hit.impulse == pytest.approx(0.04)
    assert hit.std == pytest.approx(0.3 * np.sqrt(3) * DT)
    assert (hit.start, hit.end) == pytest.approx((1.10, 1.13))


@pytest.mark.parametrize(("gap", "hits"), [(0, 3), (1, 2), (2, 1)])
def test_a_gap_may_be_inside_a_hit(gap, hits):
    found = find_impacts(result_of({"F": {10: -1.0, 12: -1.0, 15: -1.0}}), gap=gap)
    assert len(found) == hits
    assert sum(hit.impulse for hit in found) == pytest.approx(-0.03)


@pytest.mark.parametrize(("ghost", "places"), [(0.0, ["A", "B", "B"]), (0.2, ["A", "B"])])
def test_leaks_to_other_places_at_the_same_time_can_be_left_out(ghost, places):
    forces = {"A": {10: -10.0, 11: -10.0}, "B": {11: 1.0, 30: 1.0}}
    assert [hit.place for hit in find_impacts(result_of(forces), ghost=ghost)] == places


def test_what_is_not_known_is_no_force():
    found = result_of({"F": {10: 1.0}})
    found["d_hat"][20:] = np.nan
    assert len(find_impacts(found)) == 1


def test_wrong_questions_are_refused():
    found = result_of({"F": {}})
    assert find_impacts(found) == []
    with pytest.raises(DataError, match="no unknown forces 'd_hat'"):
        find_impacts(found.drop_vars("d_hat"))
    with pytest.raises(DataError, match="gap is -1"):
        find_impacts(found, gap=-1)
    with pytest.raises(DataError, match="ghost 2"):
        find_impacts(found, ghost=2.0)


def test_the_closest_times_are_paired_and_each_once():
    paired = matches(np.array([1.0, 2.0, 3.0]), np.array([0.96, 1.01, 2.04, 9.0]), tolerance=0.05)
    assert paired.pairs == ((0, 1), (1, 2))
    assert paired.missed == (2,)
    assert paired.false == (0, 3)
