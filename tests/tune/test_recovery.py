"""How surely sensors find forces, and which sensors do it best."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.errors import ModelError, TuningError
from backsight.models.lti import state_space
from backsight.models.views.some_outputs import some_outputs
from oracles import struck_beam
from tune.struck_beam_recordings import estimator

HITS = bs.tune.Hits(40, number=2, sizes=(5.0, 10.0))


def many_sensors(places) -> bs.Model:
    return bs.beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502.0,
        damping=[0.030, 0.037, 0.119],
        sensors={f"s{1000 * x:.0f}": ("displacement", x) for x in places},
        forces=dict(zip(struck_beam.FORCES, struck_beam.NODES, strict=True)),
    )


def test_hits_are_drawn_as_described():
    hits = bs.tune.Hits(30, number=5, sizes=(2.0, 3.0), spacing=4, margin=3)
    rng = np.random.default_rng(0)
    steps = []
    for _ in range(200):
        d = hits.draw(rng, 6)
        at = np.flatnonzero(d.any(axis=1))
        assert (np.count_nonzero(d, axis=1) <= 1).all()
        assert len(at) == 5
        assert np.diff(at).min() >= 4
        assert np.abs(d[d != 0]).min() >= 2.0
        assert np.abs(d).max() <= 3.0
        steps.extend(at)
    assert (min(steps), max(steps)) == (3, 26)


def test_what_more_sensors_and_less_noise_do():
    """Three sensors find what one, with more noise, does not."""
    made, model = estimator(), struck_beam.model(0.003)
    all_three = bs.tune.rate_sensors(
        made, model, HITS, dt=struck_beam.DT, selection=bs.forces.Greedy(), runs=12
    )
    assert all_three.attrs["f1"] > 0.9
    assert all_three.attrs["low"] < all_three.attrs["probability"] <= all_three.attrs["high"]
    alone = dataclasses.replace(made, noise=bs.Noise(sigma_y=1e-4))
    one = some_outputs(model, ["s1"])
    less = bs.tune.rate_sensors(
        alone, one, HITS, dt=struck_beam.DT, selection=bs.forces.Greedy(), runs=12
    )
    assert less.attrs["f1"] < all_three.attrs["f1"] - 0.2
    np.testing.assert_array_equal(all_three["exact"], all_three["f1"] == 1)


def test_a_wrong_model_finds_less():
    made, model = estimator(0.0027), struck_beam.model(0.0027)
    given = {"dt": struck_beam.DT, "selection": bs.forces.Greedy(), "runs": 8}
    right = bs.tune.rate_sensors(made, model, HITS, **given).attrs["f1"]
    wrong = bs.tune.rate_sensors(made, model, HITS, truth=struck_beam.model(0.003), **given).attrs[
        "f1"
    ]
    assert wrong < right


def test_the_moving_window_can_be_tried_too():
    made = dataclasses.replace(estimator(), threshold=1.0)
    found = bs.tune.rate_sensors(
        made, struck_beam.model(0.003), HITS, dt=struck_beam.DT, runs=4, seed=1
    )
    assert 0.3 < found.attrs["f1"] <= 1.0


def test_the_best_sensors_are_found():
    """Those at the free end, where the beam moves, and not the one near the clamp."""
    model = many_sensors((0.02, 0.165, 0.285, 0.405))
    made = dataclasses.replace(estimator(), noise=bs.Noise(sigma_y=1e-4))
    done, hits = [], bs.tune.Hits(40, sizes=(5.0, 10.0))
    given = {"dt": struck_beam.DT, "count": 2, "selection": bs.forces.Greedy(), "runs": 8}
    found = bs.tune.place_sensors(made, model, hits, progress=done.append, **given)
    assert found.attrs["search"] == "exhaustive"
    assert done == [1, 2, 3, 4, 5, 6]
    assert "s405" in found["sensors"].values[0]
    assert "s20" in found["sensors"].values[-1]
    assert "s20" not in found["sensors"].values[0]
    assert (np.diff(found["f1"]) <= 0).all()
    grown = bs.tune.place_sensors(made, model, hits, most=1, **given)
    assert grown.attrs["search"] == "greedy"
    assert "s20" not in grown["sensors"].values[0]
    assert found["f1"][0] >= grown["f1"][0]


def test_some_outputs_are_rows_of_all():
    model = many_sensors((0.1, 0.2, 0.3))
    C = state_space(model)[2]
    np.testing.assert_array_equal(state_space(some_outputs(model, ["s300", "s100"]))[2], C[[2, 0]])
    with pytest.raises(ModelError, match="did you mean 's300'"):
        some_outputs(model, ["s301"])


def test_bad_input_is_refused():
    for settings, match in (
        ({"number": 0}, "number = 0"),
        ({"sizes": (3.0, 1.0)}, "smallest and the largest"),
        ({"number": 9}, "do not fit"),
    ):
        with pytest.raises(TuningError, match=match):
            bs.tune.Hits(30, **settings)
    model = many_sensors((0.1, 0.2))
    with pytest.raises(TuningError, match="count is 3"):
        bs.tune.place_sensors(estimator(), model, HITS, dt=struck_beam.DT, count=3)
    with pytest.raises(TuningError, match="runs is 0"):
        bs.tune.rate_sensors(estimator(), struck_beam.model(0.003), HITS, dt=struck_beam.DT, runs=0)
