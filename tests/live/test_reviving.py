"""A run that is killed goes on within a second; what it acknowledged is there, once."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from tests.live.conftest import written
from tests.live.test_brokers import (
    broker,
    free_port,
    mqtt,
    needs_broker,
    publishing,
    subscribed,
)
from tests.live.test_order import check, message

from backsight.live import _reviving as reviving

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux")

COUNTED = """
import importlib.util, os, pathlib, signal, sys, time
spec = importlib.util.spec_from_file_location("reviving", sys.argv[1])
reviving = importlib.util.module_from_spec(spec)
spec.loader.exec_module(reviving)
reviving.revive(lambda sentence: print(sentence, flush=True))
runs = pathlib.Path(sys.argv[2])
runs.write_text(runs.read_text() + "x" if runs.exists() else "x")
"""


def command(folder: Path, rest: str) -> list[str]:
    """A program that counts its runs in a file; `reviving` needs nothing that takes long."""
    return [sys.executable, "-c", COUNTED + rest, str(reviving.__file__), str(folder / "runs")]


def test_what_is_killed_begins_again_and_ends_as_it_ends(tmp_path):
    rest = "os.kill(os.getpid(), signal.SIGKILL if len(runs.read_text()) < 3 else 0)\nsys.exit(7)"
    ended = subprocess.run(command(tmp_path, rest), capture_output=True, text=True, check=False)
    assert ended.returncode == 7
    assert ended.stdout.splitlines() == ["the run was killed (SIGKILL) and begins again"] * 2
    assert not ended.stderr


def test_what_is_killed_again_and_again_is_given_up(tmp_path):
    rest = "os.kill(os.getpid(), signal.SIGSEGV)"
    ended = subprocess.run(command(tmp_path, rest), capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert len((tmp_path / "runs").read_text()) == reviving.MOST
    assert "given up" in ended.stdout.splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_the_process_that_was_started(tmp_path, number):
    """SIGTERM is passed on; after SIGKILL the copy ends as if it had got one."""
    rest = (
        "ended = []\nsignal.signal(signal.SIGTERM, lambda *_: ended.append(1))\nprint('ready')\n"
        "sys.stdout.flush()\nwhile not ended: time.sleep(0.005)\nruns.write_text('clean')"
    )
    with subprocess.Popen(command(tmp_path, rest), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.stdout.read() == ""  # its other end is closed by both
    assert process.returncode == (0 if number == signal.SIGTERM else -signal.SIGKILL)
    assert (tmp_path / "runs").read_text() == "clean"


@needs_broker
@pytest.mark.slow
def test_a_kill_costs_less_than_a_second_and_no_sample(tmp_path, samples, expected):
    """The command line with a broker; samples come all the time, as from a machine."""
    port = free_port()
    file = written(tmp_path, subscribed(port))
    with contextlib.ExitStack() as stack:
        stack.enter_context(broker(tmp_path, port))
        publish = stack.enter_context(publishing(port))
        _known_to_the_broker(port)
        process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", "backsight", "live", str(file)],
                stderr=subprocess.PIPE,
                text=True,
                env=dict(os.environ, OPENBLAS_NUM_THREADS="1"),
            )
        )
        stack.callback(process.kill)
        told: list[tuple[float, str]] = []
        threading.Thread(target=_listen, args=(process, told), daemon=True).start()
        _wait(lambda: any("source rig" in sentence for _, sentence in told))
        took = []
        for part in np.array_split(samples, 4)[:-1]:
            begun = len(told)
            parts = len(list((tmp_path / "store").glob("part-*")))
            publish(map(message, part))
            _wait(lambda p=parts: len(list((tmp_path / "store").glob("part-*"))) > p)
            killed = time.monotonic()
            psutil.Process(process.pid).children()[0].kill()
            _wait(lambda b=begun: any("goes on from" in s for _, s in told[b:]))
            took.append(next(t for t, s in told[begun:] if "goes on from" in s) - killed)
        publish(map(message, np.array_split(samples, 4)[-1]))
        _wait(lambda: _stored(tmp_path) >= len(samples) - 150)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    check(tmp_path, expected)
    assert max(took) < 1.0, took


def _listen(process: subprocess.Popen, told: list[tuple[float, str]]) -> None:
    for line in process.stderr or ():
        told.append((time.monotonic(), line))


def _known_to_the_broker(port: int) -> None:
    """Subscribe once, so that the broker keeps messages for the estimator from now on."""
    client = mqtt.Client(
        mqtt.CallbackAPIVersion.VERSION2, client_id="estimator", clean_session=False
    )
    subscribed_to = threading.Event()
    client.on_connect = lambda c, *_: c.subscribe("rig/+", 1)
    client.on_subscribe = lambda *_: subscribed_to.set()
    client.connect("127.0.0.1", port)
    client.loop_start()
    assert subscribed_to.wait(10)
    client.disconnect()
    client.loop_stop()


def _stored(folder: Path) -> int:
    import pyarrow.parquet

    parts = (folder / "store").glob("part-*")
    return sum(pyarrow.parquet.read_metadata(p).num_rows for p in parts)


def _wait(happened, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.01)
