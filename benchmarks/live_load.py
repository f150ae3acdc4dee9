"""What `backsight live` takes: latency under load on the loopback, and memory over a day.

``python -m benchmarks.live_load`` sends 50 channels at 10 kHz by UDP to an estimator that has one
core, and says how long it took from the arrival of a sample to its estimate. ``--hours 24`` plays a
day as fast as it can, and says how much memory the process had after every twelfth of it.
"""

import argparse
import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil

from backsight.live import LiveSession, load_live, made_ready, opened_session
from backsight.live.running import ROUNDS, SWITCH
from backsight.live.sources import Batch

MODES = 4
TOGETHER = 10
"""Records in a datagram."""


def problem(folder: Path, *, channels: int, dt: float, block: float, store: bool) -> Path:
    """Write the problem file: modes of a structure, and sensors that see all of them."""
    rng = np.random.default_rng(1)
    names = [f"y{k}" for k in range(channels)]
    A = np.zeros((2 * MODES, 2 * MODES))
    for k, omega in enumerate(2 * np.pi * np.geomspace(0.02 / dt, 0.08 / dt, MODES) / 10):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(omega**2), -0.02 * omega]]
    C = np.zeros((channels, 2 * MODES))
    C[:, ::2] = rng.standard_normal((channels, MODES))
    B = np.zeros((2 * MODES, 1))
    B[1::2, 0] = 1.0
    outputs = "\n".join(f'outputs.{n} = "{n}"' for n in names)
    kept = '[store]\npath = "store"\nevery = 2.0\nkeep_mb = 200.0' if store else ""
    file = folder / "load.toml"
    file.write_text(f"""
[model]
kind = "lti"
states = {{ {", ".join(f'x{k} = ""' for k in range(2 * MODES))} }}
A = {A.tolist()}
B = {B.tolist()}
C = {C.tolist()}
[noise]
sigma_y = {{ {", ".join(f"{n} = 1e-3" for n in names)} }}
sigma_w = {{ {", ".join(f"x{k} = 1e-4" for k in range(2 * MODES))} }}
[prior]
sigma_x0 = {{ {", ".join(f"x{k} = 1.0" for k in range(2 * MODES))} }}
[estimators.KF]
kind = "kf"
steady_state = true
[live]
dt = {dt}
block = {block}
lag = 0.1
[source.load]
kind = "udp"
port = 0
format = "packed"
columns = {["t", "u", *names]}
struct = "<{channels + 2}d"
time = "t"
inputs.u = "u"
{outputs}
{kept}
""")
    return file


def send(port: int, *, channels: int, rate: float, seconds: float) -> None:
    """Send records at an even rate, each with the time at which it should have been sent."""
    rng, begun = np.random.default_rng(2), time.time()
    rows = rng.standard_normal((TOGETHER, channels + 2)) * 1e-3
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for k in range(int(seconds * rate / TOGETHER)):
            due = begun + k * TOGETHER / rate
            rows[:, 0] = due + np.arange(TOGETHER) / rate
            if (wait := due - time.time()) > 0:
                time.sleep(wait)
            sender.sendto(rows.tobytes(), ("127.0.0.1", port))


@contextlib.contextmanager
def opened(file: Path) -> Iterator[LiveSession]:
    """A session that says what it has to say."""
    with opened_session(made_ready(load_live(file)), tell=print) as session:
        yield session
        session.close()


def load(*, channels: int, rate: float, seconds: float, block: float, store: bool) -> None:
    """Measure the latency under load."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        file = problem(Path(folder), channels=channels, dt=1 / rate, block=block, store=store)
        session = stack.enter_context(opened(file))
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        lane, latencies = session.lanes[0], []
        port = lane.source.port  # type: ignore[attr-defined]
        command = [sys.executable, "-m", "benchmarks.live_load", "--send", str(port)]
        settings = ["--channels", str(channels), "--rate", str(rate), "--seconds", str(seconds)]
        sender = stack.enter_context(subprocess.Popen([*command, *settings]))
        sys.setswitchinterval(SWITCH)
        while not session.round():
            time.sleep(0.001)
        session.latencies.clear()
        used, begun = time.process_time(), time.monotonic()
        due = begun
        while sender.poll() is None:
            session.round()
            latencies += session.latencies
            session.latencies.clear()
            due = max(due + block / ROUNDS, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0))
        took = time.monotonic() - begun
        share = (time.process_time() - used) / took
        counts, sent = lane.placing.counts, int(seconds * rate)
        late = 1e3 * np.quantile(latencies, [0.5, 0.99, 0.999, 1.0])
        print(
            f"{channels} channels at {rate:g} Hz for {took:.0f} s, block {1e3 * block:g} ms: "
            f"latency median {late[0]:.1f} ms, 99 % {late[1]:.1f} ms, 99.9 % {late[2]:.1f} ms, "
            f"largest {late[3]:.1f} ms; {share:.0%} of a core; {counts.received} of {sent} received"
        )


def play(*, hours: float, channels: int, dt: float) -> None:
    """Play a long time as fast as possible, and look at the memory."""
    process, rng = psutil.Process(), np.random.default_rng(3)
    total = int(hours * 3600 / dt)
    with tempfile.TemporaryDirectory() as folder:
        file = problem(Path(folder), channels=channels, dt=dt, block=0.05, store=True)
        with opened(file) as session:
            source, done, begun = session.lanes[0].source, 0, time.monotonic()
            noise = rng.standard_normal((8192, channels + 2)) * 1e-3
            session.tell = print
            next_told = 0
            while done < total:
                n = min(len(noise), total - done)
                values = noise[:n].copy()
                values[:, 0] = dt * np.arange(done, done + n)
                batch = Batch(values[:, 0], values)
                source.take = lambda batch=batch: batch  # type: ignore[method-assign]
                session.round()
                session.latencies.clear()
                done += n
                if done >= next_told:
                    memory = process.memory_info().rss / 2**20
                    print(f"{done * dt / 3600:6.1f} h  {memory:7.1f} MiB", flush=True)
                    next_told += total // 12
            source.take = lambda: None  # type: ignore[method-assign]
            print(f"{total} samples in {time.monotonic() - begun:.0f} s")


def main() -> None:
    """Read the arguments and measure."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--channels", type=int, default=50)
    given.add_argument("--rate", type=float, default=1e4)
    given.add_argument("--seconds", type=float, default=20.0)
    given.add_argument("--block", type=float, default=0.05)
    given.add_argument("--store", action="store_true")
    given.add_argument("--hours", type=float)
    given.add_argument("--send", type=int)
    asked = given.parse_args()
    if asked.send is not None:
        send(asked.send, channels=asked.channels, rate=asked.rate, seconds=asked.seconds)
    elif asked.hours is not None:
        play(hours=asked.hours, channels=min(asked.channels, 4), dt=0.01)
    else:
        load(
            channels=asked.channels,
            rate=asked.rate,
            seconds=asked.seconds,
            block=asked.block,
            store=asked.store,
        )


if __name__ == "__main__":
    main()
