"""Change the program a little and see whether a test notices: ``python -m tests.mutation``.

A sample of all changes of each area is tried, drawn with a seed, with the tests that get to the
changed line. `make mutation` measures first which these are.
"""

import argparse
import json
import math
import random
import tempfile
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants_of, mutants_of_c
from tests.mutation.reaching import Reached
from tests.mutation.running import ROOT, Verdict, judge, load_all_but_the_package

PACKAGE = ROOT / "src" / "backsight"
AREAS = ("algebra", "solvers", "estimators", "kernels")

OF_KERNELS = (
    "tests/engine/test_foreign.py",
    "tests/engine/test_dense.py",
    "tests/estimators/test_cs_mhe.py",
    "tests/estimators/test_many_states.py",
    "tests/estimators/test_pulses.py",
)
"""Coverage does not see into C."""


def all_of(area: str) -> list[Mutant]:
    """Every mutant of an area."""
    if area == "kernels":
        files = [f for end in ("c", "h") for f in (PACKAGE / area).rglob(f"*.{end}")]
        left = {"bridge.c", "blas.h", "kernels.h"}
        return [m for f in sorted(files) if f.name not in left for m in mutants_of_c(f)]
    return [m for f in sorted((PACKAGE / area).rglob("*.py")) for m in mutants_of(f)]


def told(verdict: Verdict) -> dict[str, object]:
    """A survivor."""
    mutant = verdict.mutant
    text = mutant.file.read_text(encoding="utf-8").splitlines()
    return {
        "file": str(mutant.file.relative_to(PACKAGE)),
        "line": mutant.line,
        "code": text[mutant.line - 1].strip() if mutant.line else "",
        "change": mutant.change,
        "why": verdict.why,
    }


def main() -> None:
    """Try samples, print survivors, and write what came of them."""
    asked = argparse.ArgumentParser(prog="python -m tests.mutation")
    asked.add_argument("--areas", nargs="+", choices=AREAS, default=AREAS)
    asked.add_argument("--count", type=int, default=60, help="mutants of an area")
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--measured", type=Path, default=ROOT / "out" / "coverage")
    asked.add_argument("--out", type=Path, default=ROOT / "tests" / "measured" / "mutation.json")
    given = asked.parse_args()
    reached = Reached(
        sorted(given.measured.glob("*.coverage")), sorted(given.measured.glob("*.xml"))
    )
    load_all_but_the_package()
    found = json.loads(given.out.read_text()) if given.out.exists() else {}
    for area in given.areas:
        known = all_of(area)
        sample = random.Random(f"{area} {given.seed}").sample(known, min(given.count, len(known)))
        verdicts = []
        with tempfile.TemporaryDirectory() as folder:
            for mutant in sample:
                tests = list(OF_KERNELS) if area == "kernels" else reached.tests(mutant)
                verdict = judge(mutant, tests, Path(folder))
                verdicts.append(verdict)
                place = f"{mutant.file.relative_to(PACKAGE)}:{mutant.line}"
                print(
                    f"{verdict.why:9} {verdict.seconds:5.1f} s  {place} {mutant.change}", flush=True
                )
        tried = [v for v in verdicts if v.why != "not run"]
        killed = sum(v.killed for v in tried)
        share = killed / max(len(tried), 1)
        found[area] = {
            "known": len(known),
            "seed": given.seed,
            "tried": len(tried),
            "killed": killed,
            "error": math.sqrt(share * (1 - share) / max(len(tried), 1)),
            "survivors": [told(v) for v in tried if not v.killed],
        }
        print(f"{area}: {killed} of {len(tried)} were noticed", flush=True)
        given.out.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
