"""Recordings of robots as sources, and sources that have clocks of their own."""

import json
import time

import numpy as np
import pytest
from tests.live.conftest import DT, RIG, STORED, N, fed, message
from tests.live.test_order import check

from backsight.live._status import LiveStatus

START = 1_700_000_000_000_000_000
"""A moment [ns since 1970]."""


def written_mcap(path, samples) -> None:
    writers = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema("State", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("rig", "json", schema)
        for k, row in enumerate(samples):
            stamp = START + 10_000_000 * k
            writer.add_message(channel, stamp, message(row), stamp)
        writer.finish()


def written_bag(path, samples) -> None:
    bags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    point, header, moment = (
        store.types[n]
        for n in (
            "geometry_msgs/msg/PointStamped",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    place = store.types["geometry_msgs/msg/Point"]
    with bags.Writer(path, version=9, storage_plugin=bags.StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/rig", point.__msgtype__, typestore=store)
        for k, row in enumerate(samples):
            stamp = START + 10_000_000 * k
            own = point(header(moment(*divmod(stamp, 10**9)), ""), place(row[1], row[2], 0.0))
            writer.write(link, stamp, store.serialize_cdr(own, point.__msgtype__))


@pytest.mark.parametrize(
    ("write", "name", "columns"),
    [
        (written_mcap, "run.mcap", ("rig.u", "rig.y")),
        (written_bag, "run", ("rig.point.x", "rig.point.y")),
    ],
)
def test_what_robots_record_is_played_at_any_speed(
    tmp_path, samples, expected, write, name, columns
):
    write(tmp_path / name, samples)
    speed = 60.0
    source = f'kind = "replay"\npath = "{name}"\nspeed = {speed}\n'
    tables = STORED.replace('kind = "udp"\nport = 0\ntime = "t"\n', source)
    for own, column in zip(("u", "y"), columns, strict=True):
        tables = tables.replace(f'column = "{own}"', f'column = "{column}"')
    with fed(tmp_path, tables) as live:
        begun = time.monotonic()
        while not live.session.ended:
            live.session.round()
            time.sleep(0.005)
        took = time.monotonic() - begun
    assert N * DT / speed * 0.9 < took
    check(tmp_path, expected)


def test_two_sources_with_clocks_of_their_own(tmp_path):
    """Both count from somewhere, one is fast and one is slow; messages are late by chance."""
    feeds = {"a": (50e-6, 0.0, "u"), "b": (-80e-6, 4e5, "y")}
    tables = RIG.partition("[source.rig]")[0]
    for name, (_, _, signal) in feeds.items():
        kind = "inputs" if signal == "u" else "outputs"
        tables += (
            f'[source.{name}]\nkind = "udp"\nport = 0\ntime = "t"\nclock = "own"\n'
            f'{kind}.{signal} = "{signal}"\n'
        )
    rng = np.random.default_rng(8)
    times = 0.1 * np.arange(500)
    with fed(tmp_path, tables) as live:
        lanes = {lane.name: lane for lane in live.session.lanes}
        for k in range(0, len(times), 20):
            for name, (drift, zero, signal) in feeds.items():
                for t in times[k : k + 20]:
                    stamp = zero + t * (1 + drift)
                    payload = json.dumps({"t": stamp, signal: t}).encode()
                    arrival = 1e9 + t + 1e-3 + rng.exponential(2e-3)
                    lanes[name].source.inbox.put_many([payload], moment=arrival)
            live.session.round()
        shown = {s["name"]: s for s in LiveStatus(live.session).sources()}
        rows = live.session.estimation.newest(0)
        for name, (drift, _, _) in feeds.items():
            # "slow by" of a clock whose seconds are too short is negative.
            assert shown[name]["drift"] == pytest.approx(-drift, abs=15e-6)
            assert lanes[name].placing.counts.too_late == 0
    both = np.isfinite(rows.y[:, 0])
    assert both.sum() > 5
    assert np.abs(rows.u[both, 0] - rows.y[both, 0]).max() < 0.101  # the same or the one before
