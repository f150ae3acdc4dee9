"""The dashboard: what is published is what is shown, and nobody else is answered."""

import contextlib
import http.client
import json
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from tests.live.conftest import COLUMNS, RIG, STORED, fed, message
from tests.workbench.browser import FOUND, browsing

from backsight.errors import OutputError
from backsight.live._status import LiveStatus
from backsight.live.dashboard import placed_board, served_board
from backsight.live.dashboard._history import History
from backsight.problem.reading.tables import DashboardTable

ALARM = '[alarm.stiff]\nkind = "range"\nof = "k"\nupper = 38.0\n'


@contextlib.contextmanager
def shown(folder, live: str = RIG + COLUMNS + ALARM, **table):
    """A session that is fed by hand, and its dashboard."""
    with fed(folder, live) as found:
        status = LiveStatus(found.session)
        with (
            placed_board(DashboardTable(**table), folder, tell=found.told.append) as place,
            served_board(found.session, status, place) as board,
        ):
            yield found, board, place.address


def asked(address: str, path: str, body: bytes | None = None, **headers: str):
    """Status and body of an answer."""
    place = urlsplit(address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=20)
    with contextlib.closing(connection):
        method = "GET" if body is None else "POST"
        where = path if path.startswith("/") else place.path + path
        connection.request(method, where, body, {"Host": place.netloc} | headers)
        answer = connection.getresponse()
        return answer.status, answer.read()


def newest_frame(board) -> dict:
    board._due = 0.0
    board.publish(time.time())
    return json.loads(board.after(board.newest - 1)[0][-1][1])


def test_the_history_keeps_extremes_and_forgets_the_old():
    history = History(["a", "b"])
    times = 1e9 + 0.001 * np.arange(500_000)
    values = np.column_stack([np.sin(times), np.full(len(times), np.nan)])
    values[123_456, 0] = 50.0
    for k in range(0, len(times), 7001):
        part = slice(k, k + 7001)
        history.add(times[part], values[part], np.ones_like(values[part]))
    minute = history.over(60)
    assert minute["period"] == 0.05
    assert 1195 <= len(minute["t"]) <= 1202
    whole = history.over(3600)
    assert whole["period"] == 1.0
    assert 499 <= len(whole["t"]) <= 502
    assert max(whole["series"]["a"]["high"]) == 50.0
    assert set(whole["series"]["b"]["last"]) == {None}
    assert np.isclose(whole["series"]["a"]["last"][-1], values[-1, 0], rtol=1e-5)


def test_the_history_of_what_no_sensor_measures_is_no_reason_to_end():
    history = History(["a"])
    values = np.array([[1.0], [-1e308], [2.0]])
    history.add(np.array([0.0, 0.01, 0.06]), values, np.ones((3, 1)))
    assert json.loads(json.dumps(history.over(60), allow_nan=False))["series"]["a"]["last"][-1] == 2


def test_the_history_of_a_recording_that_begins_at_zero_begins_there():
    history = History(["a"])
    assert history.over(60)["t"] == []
    history.add(np.array([0.0, 0.06, 0.11]), np.ones((3, 1)), np.ones((3, 1)))
    assert history.over(60)["t"] == [0.0, 0.05, 0.1]
    assert history.fresh()["t"] == [0.0, 0.05]


def test_the_history_is_there_after_a_restart(tmp_path, samples):
    """What was kept, and what came after that from the parts of the store."""
    with shown(tmp_path, STORED) as (live, board, _):
        live.feed(map(message, samples[:400]))
    kept = tmp_path / "store" / ".history.npz"
    first = kept.read_bytes()
    with shown(tmp_path, STORED) as (live, board, _):
        live.feed(map(message, samples[400:]))
    history = board.history  # it has seen the end, which was stored after it was kept
    everything = history.over(60)
    for content in (kept.read_bytes(), first, b"damaged"):
        kept.write_bytes(content)
        with shown(tmp_path, STORED) as (_, board, _):
            end = time.monotonic() + 10
            while (found := board.history.over(60))["t"] != everything["t"]:
                assert time.monotonic() < end
                time.sleep(0.01)
        for what in ("low", "high", "last", "std"):
            right = everything["series"]["state:k"][what]
            assert found["series"]["state:k"][what] == right


def test_frames_hold_what_was_estimated(tmp_path, samples, expected):
    with shown(tmp_path) as (live, board, address):
        live.feed(map(message, samples))
        live.session._estimate(at_once=True)
        frame = newest_frame(board)
        k = next(s for s in frame["states"] if s["name"] == "k")
        assert k["value"] == pytest.approx(float(expected["x_hat"].sel(state="k")[-1]), rel=1e-12)
        assert k["unknown"]
        assert frame["verdict"]["light"] == "bad"
        assert "above 38" in frame["verdict"]["sentence"]
        status, body = asked(address, "history?span=60")
        series = json.loads(body)["series"]["state:k"]
        assert status == 200
        assert series["last"][-1] == pytest.approx(k["value"], rel=1e-5)


def test_who_does_not_know_the_token_is_not_answered(tmp_path, samples):
    with shown(tmp_path) as (live, _, address):
        live.feed(map(message, samples[:100]))
        assert asked(address, "state")[0] == 200
        assert asked(address, "/state")[0] == 403
        assert asked(address, "/x/state")[0] == 403
        assert asked(address, "state", Host="evil.example")[0] == 403
        assert asked(address, "state", Origin="http://evil.example")[0] == 403
        assert asked(address, "page/..%2f_board.py")[0] == 404
        for garbage in (b"", b"{", b"[1]", b"\xff" * 100, b'{"minutes": "x"}', b"9" * 20_000):
            assert asked(address, "save", garbage)[0] == 422
            assert asked(address, "acknowledge", garbage)[0] == 422
        for span in ("x", "nan", "-1", "1e300"):
            assert asked(address, f"history?span={span}")[0] in (200, 422)
        assert live.session.round() is False


def test_a_hundred_browsers_get_their_frames(tmp_path, samples):
    with shown(tmp_path) as (live, board, address):
        live.feed(map(message, samples[:300]))
        place = urlsplit(address)
        with contextlib.ExitStack() as stack:
            answers = []
            for _ in range(100):
                connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=20)
                stack.callback(connection.close)
                connection.request("GET", place.path + "frames", headers={"Host": place.netloc})
                answers.append(connection.getresponse())
            newest_frame(board)
            for answer in answers:
                assert answer.readline().startswith(b"data: {")
            board.ended = True  # the pages are told, and nobody has to break the connection
            for answer in answers:
                assert answer.read().endswith(b"event: ended\ndata: 1\n\n")


def test_the_last_minutes_become_a_recording_with_a_report(tmp_path, samples):
    with shown(tmp_path) as (live, board, address):
        live.feed(map(message, samples[:600]))
        status, body = asked(address, "save", b'{"minutes": 5}')
        assert status == 200
        end = time.monotonic() + 60
        while (saved := board.recent.saved[0]).state == "is estimated":
            assert time.monotonic() < end
            time.sleep(0.05)
        assert saved.state == "done"
        status, page = asked(address, f"/report/{saved.key}")
        assert status == 200
        assert b"EKF" in page
        assert asked(address, "/report/another")[0] == 404
    text = (tmp_path / "saved" / json.loads(body)["name"] / "recording.csv").read_text()
    first = text.splitlines()[1].split(",")
    assert [float(first[1]), float(first[2])] == pytest.approx(samples[0, 1:].tolist())


def test_a_port_that_is_taken_and_a_token_that_stays(tmp_path, samples):
    with shown(tmp_path, token_file="token") as (_, _, first):
        port = urlsplit(first).port
        with pytest.raises(OutputError, match="cannot be used"), shown(tmp_path, port=port):
            pass
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
    with shown(tmp_path, token_file="token") as (_, _, second):
        assert urlsplit(first).path == urlsplit(second).path
    (tmp_path / "token").write_text("short")
    with pytest.raises(OutputError, match="holds no token"), shown(tmp_path, token_file="token"):
        pass
    with pytest.raises(OutputError, match="both certificate and key"):  # noqa: SIM117
        with shown(tmp_path, certificate="cert.pem"):
            pass


@pytest.mark.skipif(FOUND is None, reason="there is no Chromium")
def test_the_page_shows_what_is_published(tmp_path, samples):
    with shown(tmp_path) as (live, board, address), browsing(tmp_path / "browser") as page:
        live.feed(map(message, samples[:600]))
        page.size(1400, 900)
        page.go(address)
        page.wait("typeof known !== 'undefined' && known && history && charts.length > 0")
        stop = threading.Event()

        def publishing():
            while not stop.wait(0.05):
                board.publish(time.time())

        thread = threading.Thread(target=publishing)
        thread.start()
        try:
            value = "document.querySelector('[data-key=\"state:k\"]').textContent"
            page.wait(f"{value} !== ''")
            page.wait("document.querySelector('#light').className === 'bad'")
            shown_k, _, band = page.value(value).partition(" ± ")
            k = next(s for s in newest_frame(board)["states"] if s["name"] == "k")
            assert float(shown_k) == pytest.approx(k["value"], rel=1e-4)
            assert float(band.split()[0]) == pytest.approx(2 * k["std"], rel=0.05)
            drawn = page.value("charts.find((c) => c.name === 'k').plot.data[3].slice(-1)[0]")
            assert drawn == pytest.approx(k["value"], rel=1e-4)
            # The prediction is drawn with what was measured, and what is out of sight not yet.
            page.value("window.scrollTo(0, document.body.scrollHeight)")
            count = len(board.described()["series"]) - 1
            page.wait(f"document.querySelectorAll('.u-wrap canvas').length === {count}")
            page.click("#alarms button")
            page.wait("document.querySelector('#alarms button').hidden")
            assert live.session.alarms.alarms["stiff"].acknowledged
            for number, (width, dark) in enumerate([(1400, False), (1400, True), (400, False)]):
                page.size(width, 900, dark=dark)
                page.value("new Promise((done) => setTimeout(done, 300))")
                assert page.value("document.documentElement.scrollWidth") <= width
                (tmp_path / f"page-{number}.png").write_bytes(page.picture())
        finally:
            stop.set()
            thread.join()
        assert not page.complaints
