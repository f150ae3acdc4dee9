"""One run of everything."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from benchmarks import accuracy, contests, files, flops, page, scaling, startup
from benchmarks.accuracy import Accuracy
from benchmarks.bars import Bar, Measured, bars
from benchmarks.contest import Contest, Row, race
from benchmarks.efficiency import Efficiency, efficiencies
from benchmarks.machine import machine
from benchmarks.peers import control_mhe
from benchmarks.scaling import Study


@dataclasses.dataclass(frozen=True)
class Run:
    """What was measured, and what follows from it."""

    machine: dict[str, str]
    contests: Sequence[Contest]
    studies: Sequence[Study]
    measured: Measured
    efficiencies: Sequence[Efficiency]
    accuracies: Sequence[Accuracy]
    bars: Sequence[Bar]

    def tell(self) -> None:
        """Print the tables and the verdict."""
        for name, value in self.machine.items():
            print(f"{name:34} {value}")
        for contest in self.contests:
            tell(contest, self.measured.rows)
        print()
        for once in self.measured.startups:
            print(f"{once.name:34} {once.best:7.3f} s, median {once.median:.3f} s")
        for e in self.efficiencies:
            share = f"{e.of_scalar:.0%} of scalar peak, {e.of_vector:.0%} of vector peak"
            print(f"{e.name:60} {e.operations:7} operations, {e.speed:5.1f} GFlop/s, {share}")
        for a in self.accuracies:
            errors = ", ".join(f"{name} {100 * value:.2f} %" for name, value in a.errors.items())
            print(f"{a.name:60} {a.time:9.1f} us per sample, {a.failure or errors}")
        print()
        for bar in self.bars:
            value = "not measured" if bar.value is None else f"{bar.value:.4g}"
            print(f"{bar.name:82} {bar.bar:>6g} {value:>12}  {'reached' if bar.met else 'MISSED'}")
        print(f"\n{page.verdict(self.bars)}")

    def keep(self, root: Path) -> None:
        """Write the results and the page."""
        found = {
            "machine": self.machine,
            "measured": self.measured,
            "efficiencies": self.efficiencies,
            "accuracies": self.accuracies,
            "bars": self.bars,
        }
        files.write(root / "benchmarks" / "results", **found)
        page.write(
            root / "docs" / "benchmarks.md", **found, contests=self.contests, studies=self.studies
        )


def tell(contest: Contest, rows: Sequence[Row]) -> None:
    """Print a table."""
    print(f"\n{contest.title} [{contest.unit}]")
    for name, best, median, ratio, difference in page.rows_of(contest, rows):
        print(f"  {name:62} {best:>9} {median:>9} {ratio:>9} {difference:>7}")


def some(words: str, *, quick: bool) -> None:
    """Measure and print the tables that have these words in their titles."""
    rounds, seconds = (3, 1.0) if quick else (25, 4.0)
    for contest in contests.contests():
        if words in contest.title:
            tell(contest, race(contest, rounds=rounds, seconds=seconds))


def everything(*, quick: bool) -> Run:
    """Measure everything; with `quick` few rounds and sizes."""
    rounds, seconds, processes = (3, 1.0, 1) if quick else (25, 4.0, 7)
    peak = flops.peak()
    described = machine(peak)
    startups = startup.startups(times=processes)
    tables = contests.contests()
    rows = []
    for table in tables:
        print(f"timing: {table.title}", flush=True)
        rows += race(table, rounds=rounds, seconds=seconds)
    rows.append(control_mhe.attempt(contests.WINDOW, contests.PYTHON_CONTROL))
    studies = scaling.studies(quick=quick)
    points = []
    for study in studies:
        print(f"timing: time per sample against {study.axis}", flush=True)
        points += scaling.carry_out(study, rounds=rounds, seconds=seconds / 4)
    print("comparing the errors of estimators", flush=True)
    measured = Measured(rows, startups, points)
    return Run(
        described,
        tables,
        studies,
        measured,
        efficiencies(rows, peak),
        accuracy.accuracies(),
        bars(measured),
    )
