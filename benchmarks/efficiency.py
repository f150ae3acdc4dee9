"""Share of the processor's peak that is used."""

import dataclasses
from collections.abc import Sequence

from benchmarks import contests, flops, problems
from benchmarks.contest import Row


@dataclasses.dataclass(frozen=True)
class Efficiency:
    """Counted operations per sample over the measured time.

    Parameters
    ----------
    name : str
    operations : int
        Per sample and recording.
    time : float
        [us per sample]
    speed : float
        [GFlop/s]
    of_scalar, of_vector : float
        Share of the peak of one core with single numbers and with vectors.
    """

    name: str
    operations: int
    time: float
    speed: float
    of_scalar: float
    of_vector: float


def efficiencies(rows: Sequence[Row], peak: flops.Peak) -> list[Efficiency]:
    """Of the observer, by itself and in lanes, and of the filters."""
    observer = problems.observer()
    cases = {
        (contests.OBSERVER, contests.NATIVE): observer,
        (contests.OBSERVER, contests.LANES): observer,
        (contests.FILTERS, contests.EKF_ODE): problems.stage_filter(),
        (contests.FILTERS, contests.UKF): problems.punch_filter(),
        (contests.FILTERS, contests.AHG_FIXED): problems.punch_observer(adaptive=False),
    }
    times = {(row.contest, row.name): row.best for row in rows}
    found = []
    for (contest, name), problem in cases.items():
        operations, time = flops.count(problem.recursion), times[contest, name]
        speed = operations / time / 1e3
        label = f"MHO: {name}" if contest == contests.OBSERVER else name
        found.append(
            Efficiency(label, operations, time, speed, speed / peak.scalar, speed / peak.vector)
        )
    return found
