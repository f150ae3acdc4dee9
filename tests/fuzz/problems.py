"""Problem files: examples and the kinds that they lack, changed as trees and as texts."""

import copy
import random
import tomllib
from pathlib import Path
from typing import Any

from tests.fuzz.isolated import Area
from tests.fuzz.mutating import mutated_text, mutated_tree, text_of

import small_problem
from backsight.problem import load, run_problem

EXAMPLES = Path(__file__).parents[2] / "examples"
SAMPLES = 80
"""Of a recording, so that a run takes a moment."""

RUNS = 40
"""Of so many problem files one is run as well."""

MOTOR = {
    "gear": {"outputs": {"q": "m", "i": "A"}},
    "live": {"dt": 0.01, "block": 0.02, "reorder": 0.05},
    "source": {"rig": {"kind": "udp", "port": 0, "time": "t", "format": "json"}},
    "alarm": {"far": {"kind": "range", "of": "k", "upper": 38.0}},
}


def trees(folder: Path) -> dict[str, dict[str, Any]]:
    """Problems that load, their recordings cut and written into the folder."""
    found = {}
    for path in sorted(EXAMPLES.glob("*/*.toml")):
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
        recording = tree.get("recording", {})
        given = recording.get("path")
        if not isinstance(given, str) or not (path.parent / given).is_file():
            continue
        _cut(path.parent / given, folder)
        for file in [*path.parent.glob("*.mtx"), *path.parent.glob("*.csv")]:
            if not (folder / file.name).exists():
                (folder / file.name).write_bytes(file.read_bytes())
        recording["path"] = Path(given).name
        for entry in tree["estimators"].values():
            if "N" in entry:
                entry["N"] = min(entry["N"], 4)
        found[f"{path.parent.name}/{path.stem}"] = tree
    small_problem.write(folder)
    small = tomllib.loads(small_problem.TEXT)
    found["small"] = small
    live = copy.deepcopy(small) | {n: t for n, t in MOTOR.items() if n != "gear"}
    found["live"] = live
    return found


def _cut(path: Path, folder: Path) -> None:
    if path.suffix == ".csv":
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        head = next(k for k, line in enumerate(lines) if line and not line.startswith("#"))
        text = "\n".join(lines[: head + 1 + SAMPLES]) + "\n"
        (folder / path.name).write_text(text, encoding="utf-8")
    else:
        (folder / path.name).write_bytes(path.read_bytes())


def area(folder: Path, *, raw: bool = False) -> Area:
    """Problem files as trees, or as texts."""
    known = trees(folder)

    def make(draw: random.Random) -> bytes:
        tree = known[draw.choice(sorted(known))]
        if raw:
            return mutated_text(text_of(tree), draw).encode("utf-8", "surrogatepass")
        return text_of(mutated_tree(tree, draw)).encode("utf-8", "surrogatepass")

    def attempt(case: bytes) -> None:
        path = folder / "case.toml"
        path.write_bytes(case)
        problem = load(path)
        if sum(case) % RUNS == 0 and problem.recording.parts is None:
            found = run_problem(problem, folder / "out", progress=lambda *_: None)
            found.table(problem.reference)
            found.verdicts(problem.reference)

    return Area("texts" if raw else "problems", make, attempt)
