"""Messages that robots record: bags of ROS and MCAP, written by their libraries."""

import json

import numpy as np
import pytest

from backsight.data import list_columns, read
from backsight.errors import DataError

N = 40
T = np.arange(N) * 0.5e-3
A, B = np.sin(np.arange(N)), np.arange(N) * 2.0
START = 1_700_000_000_000_000_000
"""A moment [ns since 1970]."""


def write_bag(path, storage):
    bags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    joints, header, moment = (
        store.types[n]
        for n in (
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    load = store.types["std_msgs/msg/Float64"]
    with bags.Writer(path, version=9, storage_plugin=bags.StoragePlugin[storage]) as writer:
        links = [
            writer.add_connection(topic, kind.__msgtype__, typestore=store)
            for topic, kind in (("/arm/joints", joints), ("/load", load))
        ]
        for k in range(N):
            stamp = START + k * 500_000
            late = stamp + 1_000_000 + 50_000 * (k % 3)  # written later, and not evenly
            head = header(moment(*divmod(stamp, 10**9)), "base")
            message = joints(head, ["x", "y"], np.array([A[k], B[k]]), np.empty(0), np.empty(0))
            for link, own in zip(links, (message, load(B[k])), strict=True):
                writer.write(link, late, store.serialize_cdr(own, own.__msgtype__))


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("whole", [True, False])
def test_bags_of_ros_2(tmp_path, storage, whole):
    bag = tmp_path / "run"
    write_bag(bag, storage)
    path = bag if whole else next(p for p in bag.iterdir() if p.suffix != ".yaml")
    asked = {
        "inputs": {},
        "outputs": {"a": "/arm/joints.position[0]", "b": "arm/joints.position[1]"},
    }
    r = read(path, **asked)
    np.testing.assert_allclose(r.time, T, atol=1e-12)
    np.testing.assert_array_equal(r.y, np.c_[A, B])
    assert r.attrs["begin"] == "2023-11-14T22:13:20"
    assert r.attrs["understood"] == "time is the headers' stamps"
    stamped = read(path, time="arm/joints.header.stamp", **asked)
    np.testing.assert_allclose(stamped.time, T, atol=1e-9)
    with pytest.raises(DataError, match="time is irregular"):
        read(path, time="arm/joints.log_time", **asked)
    logged = read(path, time="arm/joints.log_time", grid=50e-6, **asked)
    np.testing.assert_array_equal(logged.y[:, 0].dropna("time"), A)


def test_topics_without_stamps_have_the_log_time(tmp_path):
    write_bag(tmp_path / "run", "MCAP")
    r = read(tmp_path / "run", inputs={}, outputs={"b": "load.data"}, grid=50e-6)
    np.testing.assert_array_equal(r.y[:, 0].dropna("time"), B)
    both = read(
        tmp_path / "run",
        inputs={},
        outputs={"a": "arm/joints.position[0]", "b": "load.data"},
        grid=50e-6,
    )
    assert "time is the log's" in both.attrs["understood"]
    with pytest.raises(DataError, match=r"did you mean '/arm/joints\.position\[0\]'"):
        read(tmp_path / "run", inputs={}, outputs={"a": "arm/joints.positon[0]"})
    with pytest.raises(DataError, match="frame_id' is no number, but text"):
        read(tmp_path / "run", inputs={}, outputs={"a": "/arm/joints.header.frame_id"})
    with pytest.raises(DataError, match=r"joints\.position' is no number, but 2 values"):
        read(tmp_path / "run", inputs={}, outputs={"a": "/arm/joints.position"})
    found = list_columns(tmp_path / "run")
    assert [c.name for c in found.signals] == [
        "/arm/joints.position[0]",
        "/arm/joints.position[1]",
        "/load.data",
    ]


def test_types_of_messages_bring_no_programs():
    pytest.importorskip("rosbags.typesys")
    from backsight.data.formats.recorders._ros import decoder

    for name in ("a/msg/B:\n    import os\nclass C", "B", "a/msg/B\x00"):
        with pytest.raises(DataError, match="is no name of a type"):
            decoder([(name, "msg", "float64 x")], version=2)


def write_mcap(path, end=None):
    writers = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = writers.Writer(file, chunk_size=600)
        writer.start()
        schema = writer.register_schema("State", "jsonschema", b'{"type": "object"}')
        states = writer.register_channel("state", "json", schema)
        other = writer.register_channel("picture", "jpeg", 0)
        for k in range(N):
            own = {"q": [A[k], B[k]]} | ({} if k == 5 else {"load": B[k]})
            stamp = START + k * 500_000
            writer.add_message(states, stamp, json.dumps(own).encode(), stamp)
            writer.add_message(other, stamp, b"\xff", stamp)
        writer.finish()
    path.write_bytes(path.read_bytes()[:end])


def test_mcap_with_json(tmp_path):
    path = tmp_path / "r.mcap"
    write_mcap(path)
    r = read(path, inputs={}, outputs={"a": "state.q[0]", "load": "state.load"})
    np.testing.assert_array_equal(r.y, np.c_[A, np.where(np.arange(N) == 5, np.nan, B)])
    np.testing.assert_allclose(r.time, T, atol=1e-12)
    with pytest.raises(DataError, match="written in 'jpeg', which is not read"):
        read(path, inputs={}, outputs={"a": "picture.x"})
    others = {c.name: c.remarks for c in list_columns(path).columns.values() if c.kind == "other"}
    assert others["picture"] == ("messages on 'picture' are written in 'jpeg', which is not read",)


def test_mcap_of_a_recorder_that_lost_its_power(tmp_path):
    path = tmp_path / "r.mcap"
    write_mcap(path)
    write_mcap(path, path.stat().st_size // 2)
    r = read(path, inputs={}, outputs={"a": "state.q[0]"})
    assert 5 < r.sizes["time"] < N
    np.testing.assert_array_equal(r.y[:, 0], A[: r.sizes["time"]])


def test_mcap_with_protobuf(tmp_path):
    pytest.importorskip("mcap.writer")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.writer import Writer

    field = descriptor_pb2.FieldDescriptorProto
    kind = descriptor_pb2.DescriptorProto(
        name="State",
        field=[
            field(name="q", number=1, type=field.TYPE_DOUBLE, label=field.LABEL_REPEATED),
            field(name="load", number=2, type=field.TYPE_DOUBLE, label=field.LABEL_OPTIONAL),
        ],
    )
    file = descriptor_pb2.FileDescriptorProto(name="state.proto", message_type=[kind])
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    state = message_factory.GetMessageClass(pool.FindMessageTypeByName("State"))
    with (tmp_path / "r.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        types = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        schema = writer.register_schema("State", "protobuf", types)
        channel = writer.register_channel("state", "protobuf", schema)
        for k in range(N):
            data = state(q=[A[k], B[k]], load=B[k]).SerializeToString()
            writer.add_message(channel, START + k * 500_000, data, 0)
        writer.finish()
    r = read(tmp_path / "r.mcap", inputs={}, outputs={"a": "state.q[0]", "load": "state.load"})
    np.testing.assert_array_equal(r.y, np.c_[A, B])
