"""Real brokers and servers: mosquitto, and an OPC UA server from asyncua."""

import asyncio
import contextlib
import json
import shutil
import socket
import subprocess
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from tests.live.conftest import COLUMNS, DT, STORED, N, fed, message
from tests.live.test_alarms import IN_ORDER
from tests.live.test_order import check

from backsight.live.sources._decoding import payload_decoder
from backsight.live.sources._mqtt import MqttSource
from backsight.live.store import Journal, journaled
from backsight.problem.reading.tables import MessageTable, MqttFeed

MOSQUITTO = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin")
mqtt = pytest.importorskip("paho.mqtt.client", reason="paho-mqtt is not installed")
needs_broker = pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed")


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@contextlib.contextmanager
def broker(folder, port: int):
    """A broker on a port, which forgets nothing."""
    config = folder / "mosquitto.conf"
    config.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence true\n"
        f"persistence_location {folder}/\nmax_queued_messages 0\nuser root\n"
    )
    with subprocess.Popen([str(MOSQUITTO), "-c", str(config)], stderr=subprocess.DEVNULL) as run:
        try:
            end = time.monotonic() + 10
            while True:
                with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
                    break
                assert time.monotonic() < end
                time.sleep(0.02)
            yield
        finally:
            run.terminate()


@contextlib.contextmanager
def publishing(port: int):
    """Something that publishes messages and waits until the broker has them."""
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    client.loop_start()

    def publish(payloads) -> None:
        sent = [client.publish("rig/samples", p, qos=1) for p in payloads]
        for one in sent:
            one.wait_for_publish(10)

    try:
        yield publish
    finally:
        client.disconnect()
        client.loop_stop()


def subscribed(port: int) -> str:
    mqtt_lines = f'kind = "mqtt"\nport = {port}\ntopic = "rig/+"\nclient = "estimator"'
    return STORED.replace('kind = "udp"\nport = 0', mqtt_lines)


def until(live, happened, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        live.session.round()
        assert time.monotonic() < end, live.session.lanes[0].source.state
        time.sleep(0.005)


def reading(live) -> bool:
    return live.session.lanes[0].source.state.startswith("reads")


@needs_broker
def test_nothing_that_was_acknowledged_is_lost_by_a_kill(tmp_path, samples, expected):
    port = free_port()
    with broker(tmp_path, port), publishing(port) as publish:
        with fed(tmp_path, subscribed(port), killed=True) as live:
            until(live, lambda: reading(live))
            publish(map(message, samples[:500]))
            until(live, lambda: live.counts.received > 200)
        publish(map(message, samples[500:700]))  # while nobody is connected
        with fed(tmp_path, subscribed(port)) as live:
            until(live, lambda: reading(live))
            publish(map(message, samples[700:]))
            until(live, lambda: live.session.grid.newest >= N - 1 + live.session.grid.before)
    check(tmp_path, expected)


@needs_broker
@pytest.mark.slow
def test_a_broker_that_goes_and_comes_back(tmp_path, samples, expected):
    port = free_port()
    with contextlib.ExitStack() as stack:
        with broker(tmp_path, port):
            live = stack.enter_context(fed(tmp_path, subscribed(port)))
            until(live, lambda: reading(live))
            with publishing(port) as publish:
                publish(map(message, samples[:400]))
            until(live, lambda: live.counts.received == 400)
        until(live, lambda: not reading(live))
        with broker(tmp_path, port), publishing(port) as publish:
            until(live, lambda: reading(live))
            publish(map(message, samples[400:]))
            until(live, lambda: live.counts.received >= N)
            stack.close()
    check(tmp_path, expected)
    lost = next(k for k, said in enumerate(live.told) if "tries again" in said)
    assert live.told[lost + 1] == "source rig: reads rig/+ again"


def test_what_is_sent_again_is_acknowledged_once(monkeypatch):
    """Mosquitto takes a second acknowledgement for room, and lets new messages overtake."""
    acknowledged = []
    monkeypatch.setattr(mqtt.Client, "ack", lambda _, number, __: acknowledged.append(number))
    monkeypatch.setattr(mqtt.Client, "subscribe", lambda *_: None)
    outputs = {"y": {"column": "y", "unit": "m"}}
    table = {"kind": "mqtt", "host": "h", "topic": "t", "client": "c", "outputs": outputs}
    source = MqttSource("rig", MqttFeed.model_validate(table))
    source.open()
    client, fine = source._client, SimpleNamespace(is_failure=False)

    def arrives(*numbers):
        for number in numbers:
            client.on_message(client, None, SimpleNamespace(payload=b'{"y": 1}', mid=number))

    client.on_connect(client, None, None, fine, None)
    arrives(1, 2)
    source.take()
    before = source.mark()
    arrives(3)
    client.on_connect(client, None, None, fine, None)
    arrives(1, 2, 3, 4)
    source.acknowledge(before)
    assert acknowledged == []  # of the connection that is no more
    source.take()
    source.acknowledge(source.mark())
    assert acknowledged == [1, 2, 3, 4]


@needs_broker
@pytest.mark.slow
def test_alarms_and_estimates_are_published(tmp_path, samples):
    """An alarm that is raised while the broker is away waits for it."""
    port, got = free_port(), []
    tables = (
        IN_ORDER + COLUMNS + '[alarm.stiff]\nkind = "range"\nof = "k"\nupper = 38.0\n'
        f'mqtt = {{ topic = "rig/alarm", port = {port} }}\n'
        f'[sink.out]\nkind = "mqtt"\ntopic = "rig/k"\nport = {port}\nof = ["k"]\n'
    )
    with fed(tmp_path, tables) as live:
        live.feed(map(message, samples[:600]))
        assert [e["event"] for e in live.session.alarms.events] == ["raised"]
        with broker(tmp_path, port):
            listener = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
            listener.on_message = lambda _c, _d, m: got.append((m.topic, json.loads(m.payload)))
            listener.on_connect = lambda c, *_: c.subscribe("rig/#", 1)
            listener.connect("127.0.0.1", port)
            listener.loop_start()
            until(live, lambda: any(topic == "rig/alarm" for topic, _ in got))
            time.sleep(0.1)  # both tried to connect at the same times
            live.feed(map(message, samples[600:]))
            until(live, lambda: any(topic == "rig/k" for topic, _ in got))
            listener.disconnect()
            listener.loop_stop()
    alarm = next(content for topic, content in got if topic == "rig/alarm")
    assert (alarm["name"], alarm["event"]) == ("stiff", "raised")
    assert alarm["value"] == pytest.approx(40.0, abs=0.5)
    assert got[-1][1]["k"] == pytest.approx(40.0, abs=0.5)


def test_a_journal_is_read_up_to_where_it_was_written(tmp_path):
    journal = Journal(tmp_path)
    journal.append("a", [(1.5, b"one"), (2.5, b"two\nlines")])()
    remove = journal.turn()
    journal.append("b", [(3.5, b"three")])()
    journal.close()
    files = sorted(tmp_path.glob(".journal-*"))
    found = [("a", 1.5, b"one"), ("a", 2.5, b"two\nlines"), ("b", 3.5, b"three")]
    assert list(journaled(files)) == found
    files[1].write_bytes(files[1].read_bytes()[:-1])
    assert list(journaled(files)) == found[:2]
    content = bytearray(files[0].read_bytes())
    content[-1] ^= 1
    files[0].write_bytes(content)
    assert list(journaled(files[:1])) == found[:1]
    remove()
    assert sorted(tmp_path.glob(".journal-*")) == files[1:]
    assert Journal(tmp_path).left == files[1:]


def test_cbor(samples):
    cbor2 = pytest.importorskip("cbor2")
    feed = MessageTable.model_validate(
        {"kind": "mqtt", "format": "cbor", "outputs": {"y": "y"}, "time": "t"}
    )
    read = payload_decoder(feed, "source.rig")
    payloads = [cbor2.dumps({"t": 1.0, "y": [0.5]}), b"\xff\xff", cbor2.dumps([1])]
    values, owner, faults = read(payloads)
    assert values.tolist() == [[1.0, 0.5]]
    assert owner.tolist() == [0]
    assert len(faults) == 2


@pytest.mark.slow
def test_an_opc_ua_server(tmp_path, samples):
    """Values are written with the times of the samples; each variable by itself."""
    asyncua = pytest.importorskip("asyncua")
    port, beginning, done = free_port(), threading.Event(), threading.Event()
    url, trouble = f"opc.tcp://127.0.0.1:{port}/rig", []

    async def serve() -> None:
        server = asyncua.Server()
        await server.init()
        server.set_endpoint(url)
        space = await server.register_namespace("rig")
        nodes = [
            await server.nodes.objects.add_variable(asyncua.ua.NodeId(name, space), name, 0.0)
            for name in ("u", "y")
        ]
        async with server:
            beginning.set()
            while not done.is_set():
                await asyncio.sleep(0.02)
                if not writing.is_set():
                    continue
                begun = time.time()
                for row in samples[:200]:
                    moment = stamp_of(begun + row[0])
                    for node, value in zip(nodes, row[1:], strict=True):
                        await node.write_value(
                            asyncua.ua.DataValue(
                                asyncua.ua.Variant(float(value)), SourceTimestamp=moment
                            )
                        )
                writing.clear()

    def stamp_of(seconds: float):
        import datetime

        return datetime.datetime.fromtimestamp(seconds, datetime.UTC)

    def run() -> None:
        try:
            asyncio.run(serve())
        except Exception as error:
            trouble.append(error)
            beginning.set()

    writing = threading.Event()
    thread = threading.Thread(target=run)
    thread.start()
    beginning.wait(20)
    assert not trouble
    live_tables = (
        f'[live]\ndt = {DT}\nlag = 10.0\n[source.rig]\nkind = "opcua"\nurl = "{url}"\n'
        'inputs.u = "ns=2;s=u"\noutputs.y = "ns=2;s=y"\n'
    )
    try:
        with fed(tmp_path, live_tables) as live:
            until(live, lambda: live.session.lanes[0].source.state == "reads")
            writing.set()
            changes = 200 + int((np.diff(samples[:200, 1]) != 0).sum())  # what stays is not sent
            until(live, lambda: live.counts.received >= changes)
            live.session._estimate(at_once=True)
            rows = live.session.estimation.newest(0)
            found = np.flatnonzero(np.isin(rows.y[:, 0], samples[:200, 2]))
            assert len(found) > 190
            where = [int(np.flatnonzero(samples[:, 2] == y)[0]) for y in rows.y[found, 0]]
            assert np.array_equal(rows.u[found[5:], 0], samples[where[5:], 1])
    finally:
        done.set()
        thread.join()
