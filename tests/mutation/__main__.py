"""Change the program a little and see whether a test notices: ``python -m tests.mutation``.

Of all changes of each area some are tried, drawn with a seed; `make coverage` says first which
tests get to a line. The runner is tried itself before: the program as it is must pass, and a change
that cannot pass must not. What is found is added to the record, so that a run goes on where the
last one ended, and `--again` tries what has survived with the tests of today.
"""

import argparse
import ast
import dataclasses
import json
import random
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants_of, mutants_of_c
from tests.mutation.reaching import Reached
from tests.mutation.running import ROOT, Copy, Ran, load_all_but_the_package

PACKAGE = ROOT / "src" / "backsight"
AREAS = ("algebra", "solvers", "estimators", "kernels")
RECORD = ROOT / "tests" / "measured" / "mutants.json"

LONGEST = 40.0
"""Seconds of the tests of a mutant, as they take without it."""


def all_of(area: str) -> list[Mutant]:
    """Every mutant of an area."""
    if area == "kernels":
        files = [f for end in ("c", "h") for f in (PACKAGE / area).rglob(f"*.{end}")]
        left = {"bridge.c", "blas.h", "kernels.h"}
        return [m for f in sorted(files) if f.name not in left for m in mutants_of_c(f)]
    return [m for f in sorted((PACKAGE / area).rglob("*.py")) for m in mutants_of(f)]


def drawn(area: str, seed: int) -> list[Mutant]:
    """All of them in an order of chance: the first so many are a fair sample."""
    known = all_of(area)
    return random.Random(f"{area} {seed}").sample(known, len(known))


def named(mutant: Mutant) -> str:
    """A mutant in one line, by what stands there and not by its number."""
    text = mutant.file.read_text(encoding="utf-8").splitlines()
    code = text[mutant.line - 1].strip() if mutant.line else ""
    return f"{mutant.file.relative_to(PACKAGE)}: {code}: {mutant.change}"


@dataclasses.dataclass(frozen=True)
class Judge:
    """Which tests a mutant meets, and what came of them.

    Parameters
    ----------
    copy : Copy
    reached : Reached
    seconds : dict of str to float
        Tests that pass without a change, and how long they take.
    """

    copy: Copy
    reached: Reached
    seconds: dict[str, float]

    def tests(self, mutant: Mutant) -> list[str]:
        """Those that get there before the others, and the quick ones first."""
        chosen, total = [], 0.0
        for group in self.reached.tests(mutant):
            there = sorted(group & self.seconds.keys(), key=lambda n: (self.seconds[n], n))
            for name in there:
                total += self.seconds[name]
                if total > LONGEST and chosen:
                    return chosen
                chosen.append(name)
        return chosen

    def verdict(self, mutant: Mutant) -> tuple[str, str]:
        """What came of a mutant, and the test that noticed."""
        tests = self.tests(mutant)
        if not tests:
            return "no test gets there", ""
        with self.copy.changed(mutant) as is_program:
            if not is_program:
                return "no program", ""
            ran = self.copy.run(tests, self.reached.known)
        return ran.verdict, next(iter(ran.failed), "")


def without_change(copy: Copy, reached: Reached, kept: Path) -> None:
    """Note seconds of all tests that pass where the program is written anew, as mutants are."""
    for area in AREAS[:-1]:
        for file in (copy.package / area).rglob("*.py"):
            file.write_text(ast.unparse(ast.parse(file.read_text(encoding="utf-8"))) + "\n")
    assert copy.build()
    ran = copy.run(sorted(reached.known), reached.known, all_of_them=True)
    passed = {n: s for n, s in ran.seconds.items() if n not in ran.failed}
    print(f"without a change: {len(passed)} tests pass, {len(ran.failed)} fail: {ran.failed[:9]}")
    kept.write_text(json.dumps(passed), encoding="utf-8")


def controls() -> Iterator[Mutant]:
    """Changes that must be noticed."""
    for file, code, change in (
        ("algebra/symmetric.py", "length", "Add is Sub"),
        ("estimators/kalman/ekf.py", "", "Add is Sub"),
        ("solvers/trajectory/_merit.py", "chain.N + 1", "Add is Sub"),
    ):
        found = [m for m in mutants_of(PACKAGE / file) if change in m.change and code in named(m)]
        yield found[0]


def main() -> int:
    """Try mutants until the time is over; 1 if the runner itself cannot be trusted."""
    asked = argparse.ArgumentParser(prog="python -m tests.mutation")
    asked.add_argument("--areas", nargs="+", choices=AREAS, default=AREAS)
    asked.add_argument("--count", type=int, default=100, help="mutants of an area")
    asked.add_argument("--seconds", type=float, default=float("inf"))
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--again", action="store_true", help="only what has survived")
    asked.add_argument("--measured", type=Path, default=ROOT / "out" / "coverage" / "all.coverage")
    asked.add_argument("--record", type=Path, default=RECORD)
    given = asked.parse_args()
    load_all_but_the_package()
    reached = Reached(given.measured, PACKAGE)
    end = time.monotonic() + given.seconds
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        kept = given.measured.with_name("seconds.json")
        if not kept.exists():
            without_change(Copy(Path(folder, "same"), PACKAGE), reached, kept)
        copy = Copy(Path(folder, "changed"), PACKAGE)
        judge = Judge(copy, reached, json.loads(kept.read_text(encoding="utf-8")))
        if not trusted(judge):
            return 1
        found = json.loads(given.record.read_text()) if given.record.exists() else {}
        for area, mutant in turns(given, found):
            if time.monotonic() > end:
                break
            began = time.monotonic()
            why, test = judge.verdict(mutant)
            known = found.setdefault(area, {"known": len(all_of(area)), "seed": given.seed})
            known.setdefault("tried", {})[named(mutant) + f" #{mutant.number}"] = why
            took = time.monotonic() - began
            print(f"{why:9} {took:5.1f} s  {named(mutant)}  {test}", flush=True)
            given.record.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    return 0


def turns(given: argparse.Namespace, found: dict) -> Iterator[tuple[str, Mutant]]:
    """Areas by turns, each in its own order."""
    orders = {area: drawn(area, given.seed)[: given.count] for area in given.areas}
    for k in range(given.count):
        for area, order in orders.items():
            if k >= len(order):
                continue
            before = found.get(area, {}).get("tried", {})
            why = before.get(named(order[k]) + f" #{order[k].number}")
            lives = why in ("survived", "no test gets there")
            if why is None if not given.again else lives:
                yield area, order[k]


def trusted(judge: Judge) -> bool:
    """Whether the runner notices what must be noticed, and nothing where nothing is changed."""
    for mutant in controls():
        tests = judge.tests(mutant)
        same: Ran = judge.copy.run(tests, judge.reached.known)
        why, test = judge.verdict(mutant)
        print(
            f"control: {len(tests)} tests, as it is {same.verdict}; {named(mutant)}: {why}, {test}"
        )
        if same.verdict != "survived" or why != "failed":
            print("the runner cannot be trusted", file=sys.stderr)
            return False
    return True


if __name__ == "__main__":
    sys.exit(main())
