"""What reading a long text costs beside pandas and polars: ``python -m benchmarks.reading``.

Each reads the same file (time, an input, two outputs) in a process of its own, in turn; the seconds
of the processors are measured beside those on the clock, which others on the machine lengthen. What
`backsight.read` does beside parsing: it sees how the text is laid out, checks time and samples, and
puts the signals together.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

BAR = 1.3
"""So many times the processor seconds of pandas at most."""

SEEN_BEFORE = 1000
"""Rows of a first file, so that nobody pays for imports."""


def written(path: Path, rows: int) -> None:
    """Write a text with so many rows of four columns."""
    rng = np.random.default_rng(0)
    with path.open("w") as file:
        file.write("t,u,y,z\n")
        for first in range(0, rows, 100_000):
            k = np.arange(first, min(first + 100_000, rows))
            noise = rng.standard_normal((3, len(k)))
            columns = np.vstack([1e-4 * k, noise[0], noise[1], 1e3 * noise[2]]).T
            np.savetxt(file, columns, fmt=("%.4f", "%.4f", "%.6f", "%.3f"), delimiter=",")


def reader(name: str) -> Callable[[Path], object]:
    """Return what reads a file into memory."""
    if name == "pandas":
        import pandas as pd

        return pd.read_csv
    if name == "polars":
        import polars as pl

        return pl.read_csv
    import backsight as bs

    return lambda path: bs.read(path, time="t", inputs={"u": "u"}, outputs={"y": "y", "z": "z"})


def seconds(name: str, small: Path, large: Path) -> tuple[float, float]:
    """Seconds on the clock and of the processors, in this process."""
    read = reader(name)
    read(small)
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
    kept = read(large)
    after = resource.getrusage(resource.RUSAGE_SELF)
    taken = time.perf_counter() - began
    del kept
    spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return taken, spent


def main() -> None:
    """Measure and print the ratios; exit with 1 if the bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reading", description=main.__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--one", nargs=3, metavar=("NAME", "SMALL", "LARGE"), help="in here")
    arguments = parser.parse_args()
    if arguments.one:
        name, small, large = arguments.one
        print(*seconds(name, Path(small), Path(large)))
        return
    found: dict[str, list[tuple[float, float]]] = {"pandas": [], "polars": [], "backsight": []}
    with tempfile.TemporaryDirectory() as folder:
        small, large = Path(folder, "small.csv"), Path(folder, "large.csv")
        written(small, SEEN_BEFORE)
        written(large, arguments.rows)
        for _ in range(arguments.rounds):
            for name, own in found.items():
                command = [sys.executable, "-m", "benchmarks.reading", "--one", name]
                told = subprocess.run(
                    [*command, str(small), str(large)], check=True, capture_output=True, text=True
                )
                clock, spent = map(float, told.stdout.split())
                own.append((clock, spent))
    best = {name: np.min(own, axis=0) for name, own in found.items()}
    print(f"{arguments.rows} rows of 4 columns: the least of {arguments.rounds} rounds")
    for name, (clock, spent) in best.items():
        print(f"  {name:10} {clock:6.2f} s on the clock, {spent:6.2f} s of processors")
    for name in ("pandas", "polars"):
        clock, spent = best["backsight"] / best[name]
        print(f"  by {name}: {clock:.2f} on the clock, {spent:.2f} of processors")
    sys.exit(bool(best["backsight"][1] > BAR * best["pandas"][1]))


if __name__ == "__main__":
    main()
