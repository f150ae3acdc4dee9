"""What a recording that need not fit into memory costs: ``python -m benchmarks.in_parts``.

A Kalman filter with four states over four channels of an HDF5 file (an input, three outputs), in
parts of a million samples and all at once, each in a process of its own: seconds of the processors
from the first sample read to the last result written, and the largest memory of the process. A
filter this cheap makes reading and writing, which parts could make dearer, most of the work. Parts
are also measured with a quarter of the samples: their memory is that of one part.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.__main__ import ENVIRONMENT

DT = 1e-3
PART = 1_000_000
FEW = 2000
"""Samples of a first recording, so that nobody pays for imports and machine code."""

KEPT = ("x_std",)
"""Beside estimates and status."""

INPUTS = {"u": "force"}
SENSORS = {name: name for name in ("a", "b", "c")}
"""Of the model, and their columns."""

RAM, SHARE = 2.0, 0.7
"""Figures to reach: memory [GiB], and throughput in parts by that of all at once."""


def main() -> None:
    """Print a line for each way, and what follows from them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.in_parts", description=__doc__)
    parser.add_argument("--samples", type=float, default=1e7)
    parser.add_argument("--folder", type=Path, help="where the files go [a temporary one]")
    parser.add_argument("--one", choices=tuple(WAYS), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(*_measured(given.one, given.folder))
        return
    samples = int(given.samples)
    found = {}
    print(f"{'way':<10} {'samples':>10} {'us/sample':>10} {'GiB':>6}")
    for way, count in (("parts", samples // 4), ("parts", samples), ("whole", samples)):
        with tempfile.TemporaryDirectory(dir=given.folder) as folder:
            written(Path(folder) / "few.h5", FEW)
            written(Path(folder) / "long.h5", count)
            seconds, memory = _apart(way, Path(folder))
        found[way, count] = seconds / count, memory
        print(f"{way:<10} {count:>10} {1e6 * seconds / count:>10.3f} {memory:>6.2f}", flush=True)
    (quick, small), (part, large) = found["parts", samples // 4], found["parts", samples]
    growth = (large - small) / (samples - samples // 4)
    print(
        f"throughput in parts: {found['whole', samples][0] / part:.2f} of all at once (bar {SHARE})"
    )
    print(f"memory with 1e8 samples, if it grows on: {small + growth * 1e8:.2f} GiB (bar {RAM})")
    print(f"time of a sample in the long one: {part / quick:.2f} of that in the short one")


def written(path: Path, samples: int) -> None:
    """Write a recording block by block."""
    import h5py

    rng = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        columns = [file.create_dataset(name, (samples,), "f8") for name in ("force", *SENSORS)]
        for first in range(0, samples, PART):
            count = min(PART, samples - first)
            for column in columns:
                column[first : first + count] = 1e-3 * rng.standard_normal(count)


def _case():
    """Estimator and model."""
    import backsight as bs

    shapes = np.random.default_rng(1).standard_normal((4, 2))
    model = bs.modal(
        np.array([5.0, 17.0]),
        damping=0.02,
        sensors={
            name: ("displacement", row) for name, row in zip(SENSORS, shapes[:3], strict=True)
        },
        forces={},
        inputs={"u": shapes[3]},
    )
    noise = bs.Noise(sigma_y=1e-3, sigma_w=1e-3)
    return bs.KalmanFilter(noise, bs.Prior(sigma_x0=0.1)), model


def in_parts(file: Path, out: Path) -> None:
    """Part by part."""
    import backsight as bs

    parts = bs.large.read_parts(file, inputs=INPUTS, outputs=SENSORS, dt=DT, samples=PART)
    bs.large.estimate_parts(*_case(), parts, out, outputs=KEPT)


def at_once(file: Path, out: Path) -> None:
    """Read all, estimate all, write all, as a part is written."""
    import backsight as bs
    from backsight.output import netcdf_file

    recording = bs.read(file, inputs=INPUTS, outputs=SENSORS, dt=DT)
    result = bs.estimate(*_case(), recording, outputs=KEPT)
    with netcdf_file(out) as store:
        store.add(result)


WAYS: dict[str, Callable[[Path, Path], None]] = {"parts": in_parts, "whole": at_once}


def _measured(way: str, folder: Path) -> tuple[float, float]:
    """Seconds of the processor and GiB of this process."""
    work = WAYS[way]
    work(folder / "few.h5", folder / "few")
    began = time.process_time()
    work(folder / "long.h5", folder / "long")
    seconds = time.process_time() - began
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _apart(way: str, folder: Path) -> tuple[float, float]:
    """The same in a process of its own."""
    told = subprocess.run(
        [sys.executable, "-m", "benchmarks.in_parts", "--one", way, "--folder", str(folder)],
        env=os.environ | ENVIRONMENT | {"BACKSIGHT_CACHE": str(folder / "cache")},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    seconds, memory = map(float, told.stdout.split())
    return seconds, memory


if __name__ == "__main__":
    main()
