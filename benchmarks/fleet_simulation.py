"""A fleet on more workers than we have, event by event: ``python -m benchmarks.fleet_simulation``.

Four things serve one after the other: the driver, which hands out work and lands rows as
`backsight.fleet` does; the scheduler; a disk that all workers read from; and the disk of the
driver. Their times are parameters; the defaults are what a piece of work was seen to cost on one
busy core, or more.
"""

import argparse
import dataclasses
import heapq

import numpy as np

AHEAD, SECONDS = 2, 2.0
"""Pieces of work for each worker, and how long one takes, as in `backsight.fleet`."""


@dataclasses.dataclass(frozen=True)
class Times:
    """What things take [s].

    Parameters
    ----------
    recording : float
        To read and estimate a recording on a worker.
    task : float
        Of the scheduler for a piece of work, there and back.
    submit : float
        Of the driver to hand out a piece.
    commit, row : float
        To land whatever is there, and for every row of it.
    size, disk : float
        Bytes of a recording, and bytes per second of the disk that all workers share.
    spread : float
        Of the logarithm of the time of a piece.
    """

    recording: float = 0.012
    task: float = 1e-3
    submit: float = 1e-3
    commit: float = 0.03
    row: float = 4e-5
    size: float = 240e3
    disk: float = 30e9
    spread: float = 0.3


@dataclasses.dataclass(frozen=True)
class Told:
    """What came out: seconds until all is landed, shares of that time that each was busy."""

    seconds: float
    workers: float
    driver: float
    scheduler: float
    disk: float


def simulated(recordings: int, workers: int, times: Times, seed: int = 0) -> Told:
    """Run a fleet whose workers, scheduler and disks are numbers."""
    rng = np.random.default_rng(seed)
    left = recordings
    waiting: list[int] = []  # pieces at the scheduler, by their recordings
    answers: list[tuple[float, int]] = []  # pieces that are done, by when the driver can see them
    busy = [0.0] * workers
    heapq.heapify(busy)
    now = scheduler = disk = worked = served = landing = read = 0.0
    running = 0
    while left or running:
        began = now
        while running < AHEAD * workers and left:
            rest = -(-left // (2 * workers))
            size = max(min(int(SECONDS / times.recording), rest, 512), 1)
            size = min(size, left)
            left -= size
            running += 1
            now += times.submit
            waiting.append(size)
        for size in waiting:
            scheduler = max(scheduler, now) + times.task / 2
            served += times.task
            free = max(heapq.heappop(busy), scheduler)
            # Reading of all workers shares one disk.
            disk = max(disk, free) + size * times.size / times.disk
            read += size * times.size / times.disk
            spent = size * times.recording * rng.lognormal(-(times.spread**2) / 2, times.spread)
            end = max(free + spent, disk)
            worked += spent
            heapq.heappush(busy, end)
            heapq.heappush(answers, (end + times.task / 2, size))
        waiting.clear()
        if answers and answers[0][0] > now:
            landing += now - began
            now = began = answers[0][0]
        rows = 0
        while answers and answers[0][0] <= now:
            rows += heapq.heappop(answers)[1]
            running -= 1
        now += times.commit + rows * times.row
        landing += now - began
    return Told(now, worked / now / workers, landing / now, served / now, read / now)


def main() -> None:
    """Print a line for every number of workers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet_simulation")
    parser.add_argument("--recordings", type=int, default=1_000_000)
    given = parser.parse_args()
    slow = dataclasses.replace(Times(), disk=2e9)
    heavy = dataclasses.replace(Times(), recording=0.3)
    cases = {"disk of 30 GB/s": Times(), "disk of 2 GB/s": slow, "ten estimators": heavy}
    for name, times in cases.items():
        each = f"{1e3 * times.recording:.0f} ms and {times.size / 1e3:.0f} kB each"
        print(f"\n{given.recordings} recordings, {each}, {name}")
        print("workers  seconds  busy: workers  driver  scheduler  disk")
        for workers in (10, 100, 1000, 4000):
            told = simulated(given.recordings, workers, times)
            shares = (told.workers, told.driver, told.scheduler, told.disk)
            print(f"{workers:7} {told.seconds:8.0f}      ", *(f"{s:8.1%}" for s in shares))


if __name__ == "__main__":
    main()
