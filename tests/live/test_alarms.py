"""Alarms: raised when something is wrong, cleared when it is over; parameters that are frozen."""

import http.server
import json
import sys
import threading

import numpy as np
import pytest
from tests.live.conftest import COLUMNS, DT, PROBLEM, RIG, STORED, N, fed, message, stored

import backsight as bs
from backsight.errors import ProblemError
from backsight.live.alarms import Quantities, condition_of
from backsight.live.engine import LiveRows
from backsight.problem.reading.tables import HitAlarm

IN_ORDER = RIG.replace("reorder = 0.1", "reorder = 0.0").replace("lag = 1.0", "lag = 0.2")


def events(live) -> list[tuple[str, str]]:
    return [(e["name"], e["event"]) for e in live.session.alarms.events]


def test_a_parameter_that_leaves_its_range(tmp_path, samples):
    alarm = '[alarm.stiff]\nkind = "range"\nof = "k"\nlower = 30.0\nupper = 38.0\n'
    with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, samples))
        described = live.session.alarms.described()["alarms"][0]
    assert events(live) == [("stiff", "raised")]
    assert described["value"] == pytest.approx(40.0, abs=0.5)
    assert "above 38" in described["sentence"]
    assert not described["acknowledged"]
    assert live.session.alarms.acknowledge("stiff")
    assert live.session.alarms.alarms["stiff"].acknowledged
    assert not live.session.alarms.acknowledge("soft")


def test_with_hysteresis_it_does_not_flutter(tmp_path, samples):
    """The output swings around the end of the range; only what is far inside clears it."""
    swinging = samples.copy()
    swinging[:, 2] = 0.1 * np.sin(2 * np.pi * 0.5 * samples[:, 0])
    counts = []
    for hysteresis in (0.0, 0.5):
        alarm = f'[alarm.y]\nkind = "range"\nof = "y"\nupper = 0.05\nhysteresis = {hysteresis}\n'
        with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
            live.feed(map(message, swinging), at_once=20)
        counts.append(len(events(live)))
    assert counts[0] >= 6
    assert counts[1] == 1


def test_innovations_that_are_larger_than_believed(tmp_path, samples):
    alarm = '[alarm.doubt]\nkind = "nis"\nover = 1.0\n'
    noisy = samples.copy()
    noisy[500:, 2] += 5e-3 * np.random.default_rng(5).standard_normal(N - 500)
    with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, noisy), at_once=10)
    assert events(live)[0] == ("doubt", "raised")
    assert 5.0 <= live.session.alarms.events[0]["time"] <= 6.0


def test_innovations_that_are_a_little_off_are_no_alarm(tmp_path, samples):
    alarm = '[alarm.doubt]\nkind = "nis"\nover = 3.0\nlevel = 0.6\nfactor = 1.0\n'
    for factor, expected in (("1.0", True), ("1.5", False)):
        with fed(tmp_path, IN_ORDER + COLUMNS + alarm.replace("1.0", factor)) as live:
            live.feed(map(message, samples), at_once=20)
        assert bool(events(live)) == expected


def test_a_sensor_that_is_silent_and_comes_back(tmp_path, samples):
    alarm = '[alarm.sensor]\nkind = "silent"\nof = ["y"]\nafter = 0.5\n'
    gone = samples.copy()
    gone[400:500, 2] = np.nan
    with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, gone), at_once=5)
    assert events(live) == [("sensor", "raised"), ("sensor", "cleared")]
    assert live.session.alarms.events[0]["time"] == pytest.approx(4.5, abs=0.06)


def test_a_hit_with_its_size(tmp_path, samples):
    """A disturbance is asked for; a blow comes at 5 s."""
    extra = '[disturbances]\nw = { acts_on = "v", sigma = 0.5, walk = 0.5 }\n'
    alarm = '[alarm.blow]\nkind = "hit"\nthreshold = 3.0\nof = ["w"]\n'
    struck = samples.copy()
    swing = DT * np.arange(N - 500)
    struck[500:, 2] += 2.0 * np.exp(-0.4 * swing) * np.sin(6.31 * swing) / 6.31
    with fed(tmp_path, extra + IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, struck), at_once=5)
    assert events(live)[0] == ("blow", "raised")
    assert live.session.alarms.events[0]["time"] == pytest.approx(5.05, abs=0.1)
    assert abs(live.session.alarms.events[0]["value"]) > 3.0


def test_a_hit_has_a_place_a_size_and_a_unit():
    forces = {"F1": bs.Signal("N", position=0.2), "F2": bs.Signal("N", position=0.7)}
    model = bs.from_equations(
        states={"q": "m", "v": "m/s"}, outputs={"y": "m"}, parameters=forces,
        equations={"q": "v", "v": "F1 + F2 - 40*q"}, output_equations={"y": "q"},
    )  # fmt: skip
    quantities = Quantities(model, {"d_hat": ("F1", "F2"), "d_std": ("F1", "F2")})
    table = HitAlarm(kind="hit", threshold=5.0, sigmas=3.0)
    condition = condition_of(table, quantities, model, dt=DT, where="alarm.blow")
    empty = np.empty((3, 0))

    def seen(sizes, spread):
        values = {"d_hat": np.array(sizes), "d_std": np.full((3, 2), spread)}
        return condition.see(LiveRows(0, empty, np.empty((3, 1)), values))

    hit = seen([[0.0, 1.0], [4.0, -7.5], [0.0, 0.0]], 0.5)
    assert hit.there
    assert (hit.value, hit.place, hit.sentence) == (-7.5, 0.7, "F2 is -7.5 N at 0.7 m")
    assert not seen([[0.0, 1.0], [4.0, -7.5], [0.0, 0.0]], 3.0).there  # within three deviations
    assert seen([[0.0, 0.0]] * 3, 0.5).sentence == "no force is larger than its band"


def test_a_hit_is_told_once_it_is_over_with_what_chance_has_to_do_with_it():
    model = bs.from_equations(
        states={"q": "m", "v": "m/s"}, outputs={"y": "m"}, parameters={"F": bs.Signal("N")},
        equations={"q": "v", "v": "F - 40*q"}, output_equations={"y": "q"},
    )  # fmt: skip
    quantities = Quantities(model, {"d_hat": ("F",), "d_std": ("F",)})
    table = HitAlarm(kind="hit", threshold=1.0, false_alarms=1.0)
    condition = condition_of(table, quantities, model, dt=0.1, where="alarm.blow")

    def seen(start, *sizes):
        values = {"d_hat": np.array([sizes]).T, "d_std": np.full((len(sizes), 1), 0.5)}
        empty = np.empty((len(sizes), 0))
        return condition.see(LiveRows(start, empty, np.empty((len(sizes), 1)), values))

    assert not seen(0, 0.0, 6.0, 5.0).there
    assert not seen(3, 0.0).there  # it may go on
    hit = seen(4, 0.0, 0.0)
    assert (hit.there, hit.over, hit.value) == (True, False, 6.0)
    assert hit.sentence.startswith("F: 6 ± 1.5 N, 0.205 s ago; noise makes one as sure in ")
    assert seen(6, 1.5, 0.0, 0.0, 0.0).over  # three deviations come every few minutes


def test_a_status_bit_and_its_end(tmp_path, samples):
    """The estimator is told a reading that no machine has, and begins anew."""
    alarm = '[alarm.failed]\nkind = "status"\nbits = ["not_finite"]\n'
    wild = samples.copy()
    wild[500, 2] = 1e200
    with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, wild), at_once=5)
    assert events(live) == [("failed", "raised"), ("failed", "cleared")]
    assert "not finite" in live.session.alarms.events[0]["sentence"]


def test_a_command_and_a_webhook_get_it(tmp_path, samples):
    got: list[bytes] = []

    class Receiver(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            got.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Receiver) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        script = "import sys; open('got.json', 'wb').write(sys.stdin.buffer.read())"
        script = script.replace("got.json", str(tmp_path / "got.json"))
        alarm = (
            '[alarm.stiff]\nkind = "range"\nof = "k"\nupper = 38.0\n'
            f"command = {json.dumps([sys.executable, '-c', script])}\n"
            f'webhook = "http://127.0.0.1:{server.server_port}/"\n'
        )
        with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
            live.feed(map(message, samples[:600]))
        server.shutdown()
    for content in (got[0], (tmp_path / "got.json").read_bytes()):
        assert json.loads(content)["event"] == "raised"
        assert json.loads(content)["name"] == "stiff"


def test_what_cannot_be_told_is_said_and_nothing_stops(tmp_path, samples):
    alarm = (
        '[alarm.stiff]\nkind = "range"\nof = "k"\nupper = 38.0\n'
        'command = ["/there/is/no/such/program"]\nwebhook = "http://127.0.0.1:1/"\n'
    )
    with fed(tmp_path, IN_ORDER + COLUMNS + alarm) as live:
        live.feed(map(message, samples))
    assert any("cannot run" in sentence for sentence in live.told)
    assert any("cannot send" in sentence for sentence in live.told)


@pytest.mark.parametrize(
    ("alarm", "part"),
    [
        ('kind = "rang"', "unknown kind 'rang', did you mean 'range'"),
        ('of = "k"', "alarm.a.kind: is missing"),
        ('kind = "range"\nof = "kk"\nlower = 1.0', "no quantity 'kk', did you mean 'k'"),
        ('kind = "range"\nof = "k"', "give lower, upper, or both"),
        ('kind = "status"\nbits = ["not_finit"]', "did you mean 'not_finite'"),
        ('kind = "silent"\nof = ["x"]', "no output 'x'"),
        ('kind = "hit"\nthreshold = -1.0', "alarm.a.threshold"),
        ('kind = "nis"\nwebhook = "ftp://x"', "alarm.a.webhook"),
    ],
)
def test_what_is_wrong_about_an_alarm_is_said_at_once(tmp_path, alarm, part):
    with pytest.raises(ProblemError, match=part):  # noqa: SIM117
        with fed(tmp_path, IN_ORDER + COLUMNS + f"[alarm.a]\n{alarm}\n"):
            pass


def test_what_cannot_be_seen_is_frozen_and_said(tmp_path, samples, monkeypatch):
    monkeypatch.setattr("tests.live.conftest.PROBLEM", PROBLEM.replace(
        "sigma = 5.0 }", "sigma = 5.0, walk = 0.2 }"
    ))  # fmt: skip
    rest = samples.copy()
    rest[400:800, 1:] = 0.0  # the machine stands still
    found = {}
    for frozen in (False, True):
        folder = tmp_path / str(frozen)
        folder.mkdir()
        text = STORED.replace("lag = 1.0", "lag = 1.0\nfreeze = 0.5") if frozen else STORED
        with fed(folder, text) as live:
            live.feed(map(message, rest))
        found[frozen] = stored(folder, ["x_std.k", "x_hat.k"])
    said = [s for s in live.told if " k " in f" {s}"]
    assert "k cannot be seen and is frozen: excite the machine" in said
    assert "k can be seen again" in said
    seen = stored(tmp_path / "True", ["seen.k"])["seen.k"]
    assert set(seen) == {0.0, 1.0}
    assert seen[700] == 0.0
    assert seen[890] == 1.0
    drifting, frozen = found[False]["x_std.k"], found[True]["x_std.k"]
    assert drifting[799] > 1.7 * drifting[560]
    assert frozen[799] <= frozen[560]
    assert np.ptp(found[True]["x_hat.k"][560:799]) < 0.2 * frozen[799]


def test_nothing_to_freeze_is_said(tmp_path):
    with pytest.raises(ProblemError, match="no parameter has a random walk"):  # noqa: SIM117
        with fed(tmp_path, STORED.replace("lag = 1.0", "lag = 1.0\nfreeze = 0.5")):
            pass
