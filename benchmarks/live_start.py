"""From the start of `backsight live` to its first estimate, after a kill of the whole command.

``python -m benchmarks.live_start`` starts the command on samples that come by UDP all the time,
kills it with SIGKILL, starts it again, and so on: seconds from the start of the process to the
first line of its output, with everything that a first run has left: byte code, machine code and the
store. Where others use the machine, seconds of the processor tell what the start itself takes.
"""

import argparse
import contextlib
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

PROBLEM = """
[model]
kind = "equations"
states = {{ q = "m", v = "m/s" }}
outputs = {{ y = "q" }}
parameters = {{ b = 0.8 }}
[model.equations]
q = "v"
v = "u - k*q - b*v"
[estimate]
k = {{ start = 36.0, sigma = 5.0 }}
[prior]
sigma_x0 = {{ q = 0.1, v = 0.1 }}
[noise]
sigma_y = {{ y = 1e-3 }}
sigma_w = {{ v = 1e-3 }}
[estimators.EKF]
kind = "ekf"
[live]
dt = 0.01
[source.rig]
kind = "udp"
port = {port}
time = "t"
inputs.u = {{ column = "u", unit = "m/s2" }}
outputs.y = {{ column = "y", unit = "m" }}
[store]
path = "store"
every = 0.5
[sink.out]
kind = "stdout"
every = 0
"""


@contextlib.contextmanager
def sending(port: int) -> Iterator[None]:
    """Send a sample every 10 ms, whether somebody listens or not."""
    stopped = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not stopped.wait(0.01):
                text = f'{{"t": {time.time():.6f}, "u": 0.1, "y": 0.002}}'
                with contextlib.suppress(OSError):
                    out.sendto(text.encode(), ("127.0.0.1", port))

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def start(file: Path, *, stays: float) -> tuple[float, float]:
    """Seconds until the first line, and of the processor until then; killed `stays` later."""
    began = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "backsight", "live", str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        | {"OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        took, used = time.perf_counter() - began, _processor_seconds(process.pid)
        if not line:
            raise RuntimeError("it ended without an estimate")
        time.sleep(stays)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.stdout.close()
        process.wait()
    return took, used


def _processor_seconds(process: int) -> float:
    """Of a process and of its children, which go on where it forks."""
    import psutil

    parent = psutil.Process(process)
    family = [parent, *parent.children(recursive=True)]
    return sum(sum(p.cpu_times()[:2]) for p in family)


def free_port() -> int:
    """A port of UDP that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def main() -> None:
    """Print seconds of every start; the first one compiles."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live_start", description=__doc__)
    parser.add_argument("--times", type=int, default=7)
    times = parser.parse_args().times
    port = free_port()
    with tempfile.TemporaryDirectory() as folder, sending(port):
        os.environ["BACKSIGHT_CACHE"] = str(Path(folder, "cache"))
        file = Path(folder, "live.toml")
        file.write_text(PROBLEM.format(port=port), encoding="utf-8")
        first = start(file, stays=1.5)
        again = [start(file, stays=1.0) for _ in range(times)]
    print(f"first start: {first[0]:.2f} s, {first[1]:.2f} s of the processor")
    for name, values in zip(
        ("to the first estimate", "of the processor"), zip(*again, strict=True), strict=True
    ):
        print(
            f"after a kill, seconds {name}: best {min(values):.2f}, "
            f"median {statistics.median(values):.2f}, worst {max(values):.2f}"
        )


if __name__ == "__main__":
    main()
