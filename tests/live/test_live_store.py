"""The store: whole parts, going on after a kill, one writer, a full disk."""

import errno
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from tests.live.conftest import STORED, fed, message, written
from tests.live.test_order import check

import backsight as bs
from backsight.errors import OutputError
from backsight.live._status import LiveStatus
from backsight.live.store.writing import opened_live_store


def kill_after(folder, payloads) -> int:
    """Feed a session that is killed; return how many of its samples are stored then."""
    with fed(folder, STORED, killed=True) as live:
        live.feed(payloads)
        end = time.monotonic() + 10
        while live.session.keeper.stored < 100:
            live.session.round()
            time.sleep(0.01)
            assert time.monotonic() < end
    return live.session.keeper.stored


def test_after_a_kill_it_goes_on_without_loss_and_without_twice(tmp_path, samples, expected):
    kept = kill_after(tmp_path, map(message, samples[:450]))
    assert 100 <= kept < 450
    # Whoever sent what was not acknowledged sends it again, and a little before it.
    with fed(tmp_path, STORED) as live:
        assert any("goes on from" in sentence for sentence in live.told)
        live.feed(map(message, samples[max(kept - 50, 0) :]))
    check(tmp_path, expected)
    assert live.counts.too_late + live.counts.duplicates > 0


def test_what_waits_is_kept_with_the_part(tmp_path, samples, expected):
    """Samples that may still change when a part is written need not be sent again."""
    stored_rows = kill_after(tmp_path, map(message, samples[:450]))
    with fed(tmp_path, STORED) as live:
        known = live.session.estimation.measured.stop - live.session.grid.before
        assert known > stored_rows + 50
        live.feed(map(message, samples[known:]))
    check(tmp_path, expected)


def test_it_is_read_while_it_is_written(tmp_path, samples, expected):
    kept = kill_after(tmp_path, map(message, samples[:450]))
    (tmp_path / "store" / ".part-000000000000999.parquet.part").write_bytes(b"half")
    table = pd.read_parquet(tmp_path / "store")
    assert len(table) >= kept
    recording = bs.read(tmp_path / "store", inputs={"u": "u.u"}, outputs={"y": "y.y"}, time="time")
    assert recording.sizes["time"] == len(table)
    assert recording["output_unit"].values.tolist() == ["m"]
    assert np.allclose(
        table["x_hat.k"], expected["x_hat"].sel(state="k").values[: len(table)], rtol=1e-12
    )


def test_only_one_writes_and_only_its_own(tmp_path, samples):
    with fed(tmp_path, STORED) as live:
        with pytest.raises(OutputError, match="another process writes"), fed(tmp_path, STORED):
            pass
        live.feed(map(message, samples[:50]))
    other = STORED.replace("dt = 0.01", "dt = 0.02")
    with pytest.raises(OutputError, match="another estimator, model or"), fed(tmp_path, other):
        pass
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "letter.txt").write_text("dear")
    with pytest.raises(OutputError, match=r"not from here, such as letter\.txt"):  # noqa: SIM117
        with fed(tmp_path, STORED.replace('"store"', '"elsewhere"')):
            pass


def test_a_damaged_part_is_said(tmp_path, samples):
    with fed(tmp_path, STORED) as live:
        live.feed(map(message, samples[:300]))
    newest = sorted((tmp_path / "store").glob("part-*"))[-1]
    newest.write_bytes(newest.read_bytes()[:-20])
    with pytest.raises(OutputError, match="is damaged"), fed(tmp_path, STORED):
        pass


def test_a_full_disk_is_said_and_nothing_is_lost(tmp_path, samples, expected, monkeypatch):
    def full(self, *_args, **_given):
        raise OutputError("cannot write: no space left on device")

    with fed(tmp_path, STORED) as live:
        store = live.session.keeper.store
        right = store.add
        store.add = full.__get__(store)
        for k in range(0, 600, 100):
            live.feed(map(message, samples[k : k + 100]))
            time.sleep(0.06)
        assert live.session.keeper.failure
        store.add = right
        live.feed(map(message, samples[600:]))
    check(tmp_path, expected)
    said = [s for s in live.told if "no space" in s or "can be written again" in s]
    assert len(said) == 2


def test_what_finds_no_room_until_the_end_is_told(tmp_path, samples):
    def full(*_args, **_given):
        raise OutputError("cannot write: no space left on device")

    with fed(tmp_path, STORED) as live:
        live.session.keeper.store.add = full
        live.feed(map(message, samples[:150]))
    keeper = live.session.keeper
    assert (keeper.stored, keeper.given_up) == (0, 150)
    assert LiveStatus(live.session).given_up == 150
    assert "the last 150 samples are not stored" in live.told[-1]


def test_a_part_that_the_disk_refuses_leaves_nothing(tmp_path, monkeypatch):
    with opened_live_store(tmp_path / "store", said="it") as store:

        def refuse(_):
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr("os.fsync", refuse)
        with pytest.raises(OutputError, match="No space left"):
            store.add(0, {"time": np.arange(3.0)}, {}, b"memory")
        assert not list((tmp_path / "store").glob("*part*"))


def test_old_parts_go_but_never_the_newest(tmp_path):
    with opened_live_store(tmp_path / "store", said="it") as store:
        for k in range(5):
            store.add(10 * k, {"time": np.random.default_rng(k).random(1000)}, {}, b"memory")
        sizes = [p.stat().st_size for p in store.parts()]
        assert store.thin_out(before=None, largest=sum(sizes[2:]), now=time.time()) == 2
        assert store.thin_out(before=100.0, largest=None, now=time.time()) == 0
        assert store.thin_out(before=100.0, largest=None, now=time.time() + 200) == 2
        assert store.thin_out(before=0.0, largest=0, now=time.time() + 200) == 0
        assert [p.name for p in store.parts()] == ["part-000000000000040.parquet"]


@pytest.mark.slow
def test_a_process_that_is_killed_goes_on(tmp_path, samples, expected):
    """The command line, kill -9, and the command line again; samples come by TCP."""
    live = STORED.replace('kind = "udp"\nport = 0', 'kind = "stdin"')
    file = written(tmp_path, live)
    command = [sys.executable, "-m", "backsight", "live", str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as first:
        assert first.stdin is not None
        first.stdin.write(b"\n".join(map(message, samples[:450])) + b"\n")
        first.stdin.flush()
        end = time.monotonic() + 60
        while not list((tmp_path / "store").glob("part-*")):
            assert time.monotonic() < end
            time.sleep(0.05)
        first.send_signal(signal.SIGKILL)
    rest = b"\n".join(map(message, samples)) + b"\n"
    again = subprocess.run(command, input=rest, capture_output=True, timeout=120, check=True)
    assert b"goes on from" in again.stderr
    check(tmp_path, expected)
