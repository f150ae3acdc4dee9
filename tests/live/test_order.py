"""Samples that come late, twice, never, or from another time."""

import time

import numpy as np
import pytest
from tests.live.conftest import COLUMNS, DT, PROBLEM, STORED, N, fed, message, stored, written

import backsight as bs
from backsight.data import remove_delays
from backsight.live._problem import load_live


def shuffled(samples, reach: int, seed: int) -> list[np.ndarray]:
    """Samples that are overtaken by others up to `reach` later."""
    rng = np.random.default_rng(seed)
    return [samples[k] for k in np.argsort(np.arange(N) + rng.uniform(0, reach, N))]


def check(folder, expected, slack: float = 1e-12) -> None:
    found = stored(folder, ["time", "x_hat.k", "x_std.k", "y_hat.y", "y.y"])
    assert np.allclose(found["time"], DT * np.arange(N), rtol=0, atol=1e-9)
    for name, variable in (("x_hat.k", "x_hat"), ("x_std.k", "x_std")):
        right = expected[variable].sel(state="k").values
        assert np.allclose(found[name], right, rtol=slack, atol=0)
    assert np.allclose(found["y_hat.y"], expected["y_hat"].values[:, 0], rtol=0, atol=slack)
    assert np.array_equal(found["y.y"], expected["y"].values[:, 0], equal_nan=True)


def test_in_order_it_is_what_estimate_finds(tmp_path, samples, expected):
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, samples))
    check(tmp_path, expected)
    assert live.counts.late == live.counts.too_late == 0


def test_without_inputs_it_begins_with_the_first_sample(tmp_path, samples, monkeypatch):
    problem = PROBLEM.replace("u - k*q", "- k*q").replace(
        "sigma_x0 = { q = 0.1", "sigma_x0 = { q = 1.0"
    )
    monkeypatch.setattr("tests.live.conftest.PROBLEM", problem)
    swing = samples.copy()
    swing[:, 2] = 0.5 * np.exp(-0.4 * samples[:, 0]) * np.cos(6.31 * samples[:, 0])
    live_tables = STORED.replace('inputs.u = { column = "u", unit = "m/s2" }\n', "")
    live = load_live(written(tmp_path, live_tables))
    recording = bs.from_arrays(y=swing[:300, 2], dt=DT, inputs={}, outputs={"y": "m"})
    expected = bs.estimate(live.estimator, live.model, recording, engine="vm")
    with fed(tmp_path, live_tables) as run:
        run.feed(map(message, swing[:300]))
    found = stored(tmp_path, ["time", "x_std.k"])
    assert np.allclose(found["time"], DT * np.arange(300), rtol=0, atol=1e-9)
    right = expected["x_std"].sel(state="k").values
    assert np.allclose(found["x_std.k"], right, rtol=1e-12, atol=0)


def test_within_the_reorder_buffer_nothing_is_late(tmp_path, samples, expected):
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, shuffled(samples, 8, seed=1)), at_once=7)
    check(tmp_path, expected)
    assert live.counts.late == 0


def test_late_within_the_lag_is_as_if_in_order(tmp_path, samples, expected):
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, shuffled(samples, 90, seed=2)), at_once=23)
    check(tmp_path, expected)
    assert live.counts.late > 100
    assert live.counts.too_late == 0


def test_twice_is_counted_and_changes_nothing(tmp_path, samples, expected):
    doubled = [row for row in samples for _ in range(2)]
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, doubled))
    check(tmp_path, expected)
    assert live.counts.duplicates == 2 * N - 2


def test_later_than_the_lag_is_counted_and_left_out(tmp_path, samples):
    order = [*range(200), *range(201, N), 200]
    with fed(tmp_path, STORED) as live:
        live.feed(message(samples[k]) for k in order)
    assert live.counts.too_late == 1
    found = stored(tmp_path, ["y.y"])["y.y"]
    assert np.isnan(found[200])
    assert np.isfinite(found[199])


def test_times_that_cannot_be_are_counted(tmp_path, samples, expected):
    wild = samples[10].copy()
    payloads = list(map(message, samples))
    for t in (1e6, -1e300, 1e300):
        wild[0] = t
        payloads.insert(500, message(wild))
    with fed(tmp_path, STORED) as live:
        live.feed(payloads)
    check(tmp_path, expected)
    assert live.counts.implausible + live.counts.too_late == 3


def test_after_a_long_gap_the_estimator_begins_anew(tmp_path, samples):
    later = samples.copy()
    later[500:, 0] += 3600.0
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, later))
    found = stored(tmp_path, ["time", "x_std.k"])
    assert np.allclose(found["time"], later[:, 0])
    assert found["x_std.k"][500] > 10 * found["x_std.k"][499]
    assert sum("begins anew" in sentence for sentence in live.told) == 1


def test_many_samples_at_once_are_no_gap(tmp_path, samples, expected):
    with fed(tmp_path, STORED.replace("bridge = 5.0", "bridge = 0.2")) as live:
        live.feed(map(message, samples), at_once=N)
    check(tmp_path, expected)
    assert not live.told


def test_a_short_gap_is_bridged_by_the_model(tmp_path, samples):
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, np.delete(samples, range(400, 420), axis=0)))
    found = stored(tmp_path, ["time", "x_hat.k", "y.y"])
    assert len(found["time"]) == N
    assert np.isnan(found["y.y"][400:420]).all()
    assert np.isfinite(found["x_hat.k"]).all()


def test_a_clock_that_is_set_back_is_said_and_followed(tmp_path, samples):
    live_tables = STORED.replace("bridge = 5.0", "bridge = 0.2")
    later = samples.copy()
    later[400:, 0] -= 1000.0
    with fed(tmp_path, live_tables) as live:
        inbox = live.session.lanes[0].source.inbox
        for k in range(0, N, 10):
            inbox.put_many(list(map(message, later[k : k + 10])), moment=1e9 + DT * k)
            live.session.round()
    assert any("set back" in sentence for sentence in live.told)
    assert 0 < live.counts.too_late <= 40
    times = stored(tmp_path, ["time"])["time"]
    assert (np.diff(times) > 0).all()


def test_a_source_that_is_faster_than_the_grid_is_said(tmp_path, samples):
    faster = samples.copy()
    faster[300:, 0] = samples[300, 0] + 0.5 * (samples[300:, 0] - samples[300, 0])
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, faster))
    said = [
        sentence for sentence in live.told if "faster than live.dt" in " ".join(sentence.split())
    ]
    assert len(said) == 1
    assert "200 samples a second" in said[0]


def test_a_source_that_is_slower_than_the_grid_is_no_fault(tmp_path, samples):
    """Several rates: what was not measured at a sample is not measured."""
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, samples[::3]))
    found = stored(tmp_path, ["y.y", "u.u", "x_hat.k"])
    assert np.isfinite(found["y.y"]).sum() == len(samples[::3]) - np.isnan(samples[::3, 2]).sum()
    assert np.array_equal(found["u.u"][:300], np.repeat(samples[:300:3, 1], 3))
    assert not live.told


def test_a_source_that_begins_to_send_at_another_rate_is_said(tmp_path, samples):
    """By its own clock, once for each time; in bursts and with gaps it is the same rate."""
    slower = np.vstack([samples[:300], samples[300:900:5]])
    slower = np.delete(slower, np.s_[100:130], axis=0)
    with fed(tmp_path) as live:
        for part in np.split(slower, [7, 8, 200, 320]):
            live.feed(map(message, part))
    assert live.told == ["source rig sends 20 samples a second, before 100"]


DELAYED = COLUMNS.replace('column = "u"', 'column = "u", delay = 0.004').replace(
    'column = "y"', 'column = "y", delay = 0.013'
)


@pytest.mark.parametrize("reach", [0, 90])
def test_delays_of_a_part_of_a_sample_are_taken_out_as_of_a_recording(tmp_path, samples, reach):
    """Also of samples that come late, and by a run that was killed in between."""
    live_tables = STORED.replace(COLUMNS, DELAYED)
    live = load_live(written(tmp_path, live_tables))
    units = {"inputs": {"u": "m/s2"}, "outputs": {"y": "m"}}
    recording = bs.from_arrays(u=samples[:, 1], y=samples[:, 2], dt=DT, **units)
    moved = remove_delays(recording, {"u": 0.004, "y": 0.013})
    expected = bs.estimate(live.estimator, live.model, moved, engine="vm")
    order = shuffled(samples, reach, seed=4)
    with fed(tmp_path, live_tables, killed=True) as first:
        first.feed(map(message, order[:450]))
        end = time.monotonic() + 10
        while not first.session.keeper.stored:
            first.session.round()
            assert time.monotonic() < end
    with fed(tmp_path, live_tables) as second:
        known = second.session.grid.newest + 1 - second.session.grid.before
        # In order, nothing is sent again; else whoever sends does not know what is stored.
        second.feed(map(message, order if reach else order[known:]))
    found = stored(tmp_path, ["time", "x_hat.k", "x_std.k", "y.y", "u.u"])
    n = moved.sizes["time"] - 1  # the last outputs are not known yet
    assert np.allclose(found["time"][:n], DT * np.arange(n), rtol=0, atol=1e-9)
    assert np.allclose(found["y.y"][:n], moved["y"][:n, 0], rtol=0, atol=1e-15, equal_nan=True)
    assert np.allclose(found["u.u"][:n], moved["u"][:n, 0], rtol=0, atol=1e-15)
    for name, variable in (("x_hat.k", "x_hat"), ("x_std.k", "x_std")):
        right = expected[variable].sel(state="k").values[:n]
        assert np.allclose(found[name][:n], right, rtol=1e-12, atol=0)
    assert (first.counts.late > 50) == (reach == 90)
