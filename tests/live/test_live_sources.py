"""Sources on the wire: UDP, TCP, serial lines; what cannot be read is counted."""

import contextlib
import math
import os
import socket
import struct
import time

import numpy as np
import pytest
from tests.live.conftest import COLUMNS, N, fed, message, written

from backsight.errors import BacksightError, OutputError, ProblemError
from backsight.live._opening import opened_session
from backsight.live._problem import load_live
from backsight.live._ready import made_ready
from backsight.live._session import MOST_TOLD
from backsight.live.sources._cutting import Cutter
from backsight.live.sources._decoding import payload_decoder
from backsight.problem.reading.tables import MessageTable

LIVE = "[live]\ndt = 0.01\nlag = 1.0\n[source.rig]\ntime = 't'\n"
PACKED = 'format = "packed"\ncolumns = ["t", "u", "y"]\nstruct = "<dff"\n'


def arrive(session, count: int, seconds: float = 10.0) -> None:
    """Do rounds until so many samples have arrived."""
    end = time.monotonic() + seconds
    while session.lanes[0].placing.counts.received < count:
        session.round()
        assert time.monotonic() < end, session.lanes[0].source.state
        time.sleep(0.002)


def newest_k(session) -> float:
    session.estimation.advance(session.grid.newest + 1, at_once=True)
    return session.estimation.newest(0).values["x_hat"][-1, 2]


def test_packed_datagrams_over_the_loopback(tmp_path, samples, expected):
    with fed(tmp_path, LIVE + 'kind = "udp"\nport = 0\n' + PACKED + COLUMNS) as live:
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.closing(sender):
            for k in range(0, N, 20):  # several records in a datagram
                rows = b"".join(struct.pack("<dff", *row) for row in samples[k : k + 20])
                sender.sendto(rows, ("127.0.0.1", live.session.lanes[0].source.port))
            sender.sendto(b"12345", ("127.0.0.1", live.session.lanes[0].source.port))
            arrive(live.session, N)
        assert math.isclose(
            newest_k(live.session), float(expected["x_hat"][-1, 2]), rel_tol=1e-4
        )  # single precision on the wire
        end = time.monotonic() + 5
        while not live.counts.malformed:
            live.session.round()
            assert time.monotonic() < end
    assert [s for s in live.told if "5 bytes, not a multiple of 16" in s]


def test_lines_over_tcp_in_any_pieces(tmp_path, samples, expected):
    text = 'kind = "tcp"\nport = 0\nlisten = true\nformat = "text"\ncolumns = ["t", "u", "y"]\n'
    content = b"".join(
        f"{t!r},{u!r},{'' if np.isnan(y) else repr(float(y))}\n".encode()
        for t, u, y in ((float(r[0]), float(r[1]), r[2]) for r in samples)
    )
    with fed(tmp_path, LIVE + text + COLUMNS) as live:
        source = live.session.lanes[0].source
        for half in (content[:10_001], content[10_001:]):  # who connects again goes on
            with socket.create_connection(("127.0.0.1", source.port)) as peer:
                for k in range(0, len(half), 777):
                    peer.sendall(half[k : k + 777])
        arrive(live.session, N - 2)
        # The line that the break has cut is two that cannot be read.
        assert 2 <= live.counts.malformed + N - live.counts.received <= 3


def test_a_server_that_comes_later_is_found(tmp_path, samples):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    text = f'kind = "tcp"\nport = {port}\nformat = "json"\n'
    with fed(tmp_path, LIVE + text + COLUMNS) as live:
        end = time.monotonic() + 10
        while not live.told:  # that nobody is there, once
            live.session.round()
            assert time.monotonic() < end
            time.sleep(0.005)
        with socket.socket() as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind(("127.0.0.1", port))
            server.listen()
            server.settimeout(10)
            peer, _ = server.accept()
            with peer:
                peer.sendall(b"\n".join(map(message, samples)) + b"\n")
                arrive(live.session, N)
        lost, found = live.told
        assert lost.endswith("tries again")
        assert found == "source rig: reads again"


@pytest.mark.skipif(os.name == "nt", reason="there are no pseudo-terminals")
def test_a_serial_line(tmp_path, samples):
    pytest.importorskip("serial")
    here, there = os.openpty()
    import tty

    tty.setraw(here)
    text = f'kind = "serial"\ndevice = "{os.ttyname(there)}"\nformat = "json"\n'
    with fed(tmp_path, LIVE + text + COLUMNS) as live:
        while live.session.lanes[0].source.state != "reads":
            time.sleep(0.01)  # what comes before is thrown away
        for row in samples[:200]:
            os.write(here, message(row) + b"\r\n")
            live.session.round()
        arrive(live.session, 200)
    os.close(here)
    os.close(there)


def test_what_cannot_be_read_is_counted_and_the_rest_is_used(tmp_path, samples, expected):
    bad = [
        b"\xff\xfe garbage",
        b"{",
        b"[" * 100_000,
        b'"text"',
        b"17",
        b'{"t": 1.0, "y": "high"}',
        b'{"t": 1.0, "y": true}',
        b'{"t": 1.0, "y": Infinity}',
        b'{"other": 1}',
        b'{"t": [1, 2], "y": [1, 2, 3]}',
        b'{"t": 1.0, "y": 1.0, "units": {"y": "mm"}}',
    ]
    payloads = list(map(message, samples))
    for k, payload in enumerate(bad):
        payloads.insert(50 * k, payload)
    with fed(tmp_path) as live:
        live.feed(payloads)
        assert live.counts.malformed == len(bad)
        assert newest_k(live.session) == pytest.approx(float(expected["x_hat"][-1, 2]), rel=1e-12)
    assert len([s for s in live.told if "cannot read" in s]) == 1
    # Of every other reason the first one is shown, too: a unit that changes is no garbage.
    others = [s for s in live.told if "refuses" in s]
    assert len([s for s in others if "mm" in s]) == 1
    assert 2 <= len(others) < MOST_TOLD


def table(**given) -> MessageTable:
    given = {"kind": "udp", "inputs": {"u": "u"}, "outputs": {"y": "y"}, "time": "t"} | given
    return MessageTable.model_validate(given)


@pytest.mark.parametrize(
    ("lines", "values", "faults"),
    [
        ([b"1,2,3", b"4,5,6"], [[1, 2, 3], [4, 5, 6]], 0),
        ([b"1, 2 ,", b" 4,5,6"], [[1, 2, np.nan], [4, 5, 6]], 0),
        ([b"1,2", b"4,5,6,7", b"8,9,1"], [[8, 9, 1]], 2),
        ([b"1,2,x", b"1_0,2,3", b"1,inf,3", b"nan,2,3"], [[np.nan, 2, 3]], 3),
    ],
)
def test_lines_of_numbers(lines, values, faults):
    read = payload_decoder(table(format="text", columns=["t", "u", "y"]), "source.rig")
    found, owner, wrong = read(lines)
    assert np.array_equal(found, np.array(values, float), equal_nan=True)
    assert len(owner) == len(found)
    assert len(wrong) == faults


def test_records_of_every_kind_of_number():
    feed = table(format="packed", columns=["t", "n", "u", "y"], struct=">Qhfd")
    found, _, _ = payload_decoder(feed, "source.rig")([struct.pack(">Qhfd", 2**40, -3, 0.5, 1e-9)])
    assert found.tolist() == [[2**40, 0.5, 1e-9]]


def test_a_line_without_an_end_is_given_up():
    cutter = Cutter(table(), "source.rig")
    for _ in range(40):
        assert cutter.cut(b"x" * 2**15) == []
    assert cutter.oversized == 1
    assert cutter.cut(b"x\n{}\n")[-1] == b"{}"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('kind = "upd"\nport = 0\n' + COLUMNS, "source.rig.kind: unknown kind 'upd', did you mean"),
        ('kind = "udp"\nport = 99999\n' + COLUMNS, "source.rig.port"),
        ('kind = "udp"\nport = 0\ninputs.u = "u"\n', "no source has an output"),
        ('kind = "udp"\nport = 0\nformat = "text"\n' + COLUMNS, "source.rig.columns: is missing"),
        ('kind = "udp"\nport = 0\nformat="packed"\ncolumns=["t","u","y"]\nstruct="dd"\n' + COLUMNS,
         "source.rig.struct: must be < or >"),
        ('kind = "udp"\nport = 0\nformat="packed"\ncolumns=["t","u","y"]\nstruct="<dd"\n' + COLUMNS,
         "holds 2 numbers, but there are 3"),
        ('kind = "udp"\nport = 0\ninputs.u = "u"\noutputs.y = { column = "y", delay = 1.5 }\n',
         "source.rig.outputs.y.delay: is longer than samples may be late; give live.lag"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_the_file_is_said_before_anything_runs(tmp_path, text, part):
    with pytest.raises(ProblemError, match=part.replace("(", r"\(")):
        begin(tmp_path, LIVE + text)


def begin(folder, text: str) -> None:
    ready = made_ready(load_live(written(folder, text)), engine="vm")
    with opened_session(ready, tell=print):
        pass


def test_a_port_that_is_taken_is_said(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=f"source.rig: cannot listen on 127.0.0.1:{port}"):
            begin(tmp_path, LIVE + f'kind = "udp"\nport = {port}\n' + COLUMNS)


def test_without_a_source_or_a_recording_there_is_nothing_to_do(tmp_path):
    with pytest.raises(BacksightError, match=r"say where samples come from, \[source.NAME\]"):
        begin(tmp_path, "[live]\ndt = 0.01\n")
