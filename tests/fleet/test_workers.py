"""Fleets on dask.distributed: the same rows, whoever does the work and whoever dies."""

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time

import psutil
import pytest
from tests.fleet.springs import write_fleet

from backsight.errors import WorkerError
from backsight.fleet import _workers, load_fleet, run_fleet
from backsight.fleet.items import done
from backsight.fleet.rows.store import ROWS

distributed = pytest.importorskip("distributed")


def kept(out):
    with contextlib.closing(sqlite3.connect(out / ROWS)) as file:
        return dict(file.execute("SELECT item || estimator, row FROM rows"))


@pytest.fixture
def scheduler():
    """Address of a scheduler whose workers are threads of this process."""
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        yield cluster.scheduler_address


def test_rows_of_a_scheduler_are_those_of_one_process(tmp_path, scheduler):
    fleet = load_fleet(write_fleet(tmp_path, count=12))
    run_fleet(fleet, tmp_path / "here", workers=0)
    counts: list[tuple[int, int]] = []
    run_fleet(
        fleet, tmp_path / "there", scheduler=scheduler, progress=lambda *done: counts.append(done)
    )
    assert kept(tmp_path / "here") == kept(tmp_path / "there")
    assert counts[0] == (0, 12)
    assert counts[-1] == (12, 12)


def test_a_worker_with_another_version_is_refused(tmp_path, scheduler, monkeypatch):
    fleet = load_fleet(write_fleet(tmp_path))
    real = distributed.Client.run

    def other(client, *given, **options):
        return dict.fromkeys(real(client, *given, **options), "0.0.1")

    monkeypatch.setattr(distributed.Client, "run", other)
    with pytest.raises(WorkerError, match=r"has version 0\.0\.1 of Backsight"):
        run_fleet(fleet, tmp_path / "store", scheduler=scheduler)


def test_a_worker_that_comes_later_with_another_version_is_refused(tmp_path, monkeypatch):
    fleet = load_fleet(write_fleet(tmp_path))
    monkeypatch.setattr("backsight.fleet.items._doing.version_here", lambda: "0.0.1")
    with pytest.raises(WorkerError, match=r"a worker has version 0\.0\.1"):
        run_fleet(fleet, tmp_path / "store", workers=0)


def test_a_scheduler_that_does_not_answer(tmp_path, monkeypatch):
    fleet = load_fleet(write_fleet(tmp_path))
    monkeypatch.setattr(_workers, "CONNECT", "1s")
    with pytest.raises(WorkerError, match="does not answer"):
        run_fleet(fleet, tmp_path / "store", scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize(
    ("address", "said"),
    [("nonsense", "missing port"), ("127.0.0.1", "missing port"), ("foo://a:1", "scheme 'foo'")],
)
def test_an_address_that_is_none_is_told_before_anything_connects(
    tmp_path, monkeypatch, address, said
):
    """A client that was begun with it takes half a minute to end, with a traceback."""

    def begun(*_args, **_words):
        raise AssertionError("connects")

    monkeypatch.setattr(distributed, "Client", begun)
    with pytest.raises(WorkerError, match=f"'{address}' does not answer.*{said}"):
        run_fleet(load_fleet(write_fleet(tmp_path)), tmp_path / "store", scheduler=address)


def test_a_scheduler_that_goes_is_told_and_what_is_finished_stays(tmp_path, scheduler, monkeypatch):
    fleet = load_fleet(write_fleet(tmp_path, count=20))
    real, gone = distributed.Client.nthreads, []

    def nthreads(client):
        if gone:
            raise distributed.comm.CommClosedError("in <TCP (closed)>")
        return real(client)

    monkeypatch.setattr(distributed.Client, "nthreads", nthreads)
    monkeypatch.setattr("backsight.fleet._plan.SECONDS", 0.0)
    with pytest.raises(WorkerError, match="connection to the scheduler is lost"):
        run_fleet(
            fleet,
            tmp_path / "store",
            scheduler=scheduler,
            progress=lambda done, _: gone.append(done) if done else None,
        )
    assert 0 < len(kept(tmp_path / "store")) < 20


def test_work_that_kills_is_cut_down_to_the_recording_that_does_it(tmp_path, monkeypatch):
    """Three recordings go together; the one that kills is a row, the others have theirs."""

    class Mortal(_workers.ThisProcess):
        def finished(self):
            work = self._waiting.popleft()
            deadly = any("r1" in piece.listed.name for piece in work.pieces)
            yield work, "the worker died of it" if deadly else done(work)

    monkeypatch.setattr(_workers, "ThisProcess", Mortal)
    path = write_fleet(tmp_path)
    run_fleet(load_fleet(path), tmp_path / "store", workers=0)
    rows = kept(tmp_path / "store")
    assert len(rows) == 3
    assert sum("died of it" in row for row in rows.values()) == 1
    monkeypatch.undo()
    assert run_fleet(load_fleet(path), tmp_path / "store", workers=0).before == 2
    assert not any("died of it" in row for row in kept(tmp_path / "store").values())


@pytest.mark.slow
def test_killed_workers_and_drivers_lose_nothing_but_what_is_running(tmp_path):
    path, out = write_fleet(tmp_path, count=120), tmp_path / "store"
    run_fleet(load_fleet(path), tmp_path / "whole", workers=0)

    def started():
        command = [sys.executable, "-m", "backsight", "fleet", path, "--out", out, "--workers", "2"]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def wait_for(count, process):
        while process.poll() is None:
            with contextlib.suppress(sqlite3.Error):
                if (out / ROWS).exists() and len(kept(out)) >= count:
                    return
            time.sleep(0.05)

    first = started()
    wait_for(8, first)
    workers = [
        child
        for child in psutil.Process(first.pid).children(recursive=True)
        if "spawn_main" in " ".join(child.cmdline())
    ]
    workers[0].kill()
    wait_for(30, first)
    os.kill(first.pid, signal.SIGKILL)
    first.communicate()
    before = kept(out)
    assert 0 < len(before) < 120
    second = started()
    printed, told = second.communicate()
    assert (second.returncode, told) == (0, "")
    assert "120 recordings" in printed
    assert kept(out) == kept(tmp_path / "whole")
    assert before.items() <= kept(out).items()
