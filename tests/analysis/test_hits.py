"""Hits in a result: which forces count, how large they are, and what the verdict says of them."""

import dataclasses
import functools

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.analysis.comparison import verdicts
from backsight.analysis.comparison._summary import assess, summary
from backsight.analysis.forces import FoundHits, forces, hits

DT, N = 1 / 400, 200
PLACES = {"root": 0.165, "middle": 0.285, "tip": 0.405}
HIT = {60: ("tip", -10.0), 130: ("root", 6.0)}


def beam(**changes):
    sensors = {f"y{i}": ("displacement", x) for i, x in enumerate((0.245, 0.325, 0.405))}
    return bs.beam(
        0.405,
        bending_stiffness=3.7,
        mass_per_length=0.56,
        damping=0.03,
        sensors=sensors | changes,
        forces=PLACES,
    )


def recording(hit=HIT, *, model=None, noise=2e-7):
    model = beam() if model is None else model
    push = np.zeros((N, len(PLACES)))
    for k, (name, force) in hit.items():
        push[k, list(PLACES).index(name)] = force
    made = bs.simulate(
        bs.forces.forces_as_inputs(model, list(PLACES)), push, dt=DT, sigma_y=noise, seed=2
    )
    return made.drop_dims(["input", "state"]).assign(u=(("time", "input"), np.zeros((N, 0))))


NOISE, PRIOR = bs.Noise(sigma_y=2e-7), bs.Prior(sigma_x0=1e-4)
DENSE = bs.JointInput(NOISE, PRIOR, forces=tuple(PLACES))


def sparse(**changes):
    settings = {"lam": 20.0, "sigma_force": 0.1, "threshold": 0.5} | changes
    return bs.CompressiveSensingMHE(NOISE, PRIOR, forces=tuple(PLACES), **settings)


@functools.cache
def found_by(kind):
    """Result of the estimator that says of every sample, or of the one that says of a few."""
    return bs.estimate({"dense": DENSE, "sparse": sparse()}[kind], beam(), recording())


@pytest.mark.parametrize("kind", ["dense", "sparse"])
def test_hits_have_their_time_place_and_size(kind):
    found = hits(found_by(kind))
    assert found.unit == "N"
    assert [hit.where for hit in found.hits] == ["tip (0.405)", "root (0.165)"]
    for hit, (k, (name, force)) in zip(found.hits, HIT.items(), strict=True):
        assert hit.impact.place == name
        assert hit.position == PLACES[name]
        assert hit.impact.time == pytest.approx((k + 0.5) * DT)
        assert hit.force == pytest.approx(force, rel=0.1)
        assert abs(hit.force - force) < 4 * hit.std
        assert hit.impact.impulse == pytest.approx(force * DT, rel=0.1)
    assert str(found).startswith("2 hits found, the largest at 0.1512 s at tip (0.405): −")


def test_a_force_that_is_seen_at_once_is_that_of_its_own_interval():
    sensors = {f"y{i}": ("acceleration", x) for i, x in enumerate((0.245, 0.325, 0.405))}
    model = beam(**sensors)
    result = bs.estimate(
        bs.JointInput(bs.Noise(sigma_y=1e-2), bs.Prior(sigma_x0=1e-6), forces=tuple(PLACES)),
        model,
        recording(model=model, noise=1e-2),
    )
    assert [hit.impact.start for hit in hits(result).hits] == pytest.approx([60 * DT, 130 * DT])


def test_chance_makes_no_hits():
    result = bs.estimate(DENSE, beam(), recording({}))
    found = hits(result)
    assert found.hits == ()
    assert str(found) == "no hit found"
    assert np.abs(result["d_hat"]).max() > 0


def test_without_forces_there_is_nothing_to_say():
    result = bs.estimate(bs.KalmanFilter(NOISE, PRIOR), beam(), recording({}))
    assert hits(result) is None
    assert summary(result)["hits"] is None


def test_forces_begin_with_their_sample_and_unknown_ones_are_zero():
    held = xr.DataArray([[1.0], [2.0], [np.nan]], dims=("time", "force"), attrs={"ago": 1})
    moved, std = forces(xr.Dataset({"d_hat": held}))
    np.testing.assert_array_equal(moved[:, 0], [2.0, 0.0, 0.0])
    np.testing.assert_array_equal(std, np.zeros((3, 1)))


def test_the_summary_lists_the_largest():
    listed = summary(found_by("sparse"))["hits"]
    assert listed["count"] == 2
    assert [entry["place"] for entry in listed["largest"]] == ["tip", "root"]
    assert {"time", "position", "force", "std", "impulse", "impulse_std"} < set(
        listed["largest"][0]
    )


@pytest.mark.parametrize("kind", ["dense", "sparse"])
def test_innovations_with_forces_in_them_are_not_held_against_the_bands(kind):
    row = assess(found_by(kind), name="E")
    assert row.mean_nis > 2 * row.nis_expected
    (said,) = verdicts([row])
    assert "over-confident" not in said
    assert "too small" not in said
    assert "contain the unknown forces and are" in said
    assert said.startswith("E: 2 hits found")


def test_without_hits_large_innovations_are_over_confidence():
    row = assess(found_by("dense"), name="E")
    (said,) = verdicts([dataclasses.replace(row, hits=FoundHits((), "N"))])
    assert "over-confident" in said


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        ({"lam": 1e6}, "no force was found in the whole recording: lam is at or above lambda_max"),
        ({"threshold": 50.0}, "are below the threshold"),
    ],
)
def test_settings_that_hide_all_forces_are_said_and_no_other_cause(changes, remark):
    row = assess(bs.estimate(sparse(**changes), beam(), recording()), name="E")
    (said,) = verdicts([row])
    assert remark in said
    assert "over-confident" not in said
    assert "hits found" not in said
