"""What a study found, in a form that a program can read."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path

from backsight.output import write_whole


@dataclasses.dataclass(frozen=True)
class Check:
    """One number or statement held against what a study measured.

    Parameters
    ----------
    name : str
        What is checked.
    paper : float or str
        The value to meet, or the statement; of the paper unless the name says otherwise.
    measured : float or str
        What the study found.
    tolerance : float or str
        Largest relative deviation, or what a statement has to satisfy.
    passed : bool
    where : str
        File and row that the measured value can be looked up in.
    """

    name: str
    paper: float | str
    measured: float | str
    tolerance: float | str
    passed: bool
    where: str


def near(name: str, paper: float, measured: float, *, tolerance: float, where: str) -> Check:
    """Check a number against a value that is not zero, by its relative deviation."""
    deviation = abs(measured / paper - 1.0)
    passed = math.isfinite(deviation) and deviation <= tolerance
    return Check(name, paper, measured, tolerance, passed, where)


def write_checks(path: Path, checks: Sequence[Check]) -> None:
    """Write ``checks.json``: a list with the fields of `Check`, numbers that are NaN as null."""
    rows = [{k: _plain(v) for k, v in dataclasses.asdict(c).items()} for c in checks]
    write_whole(path, (json.dumps(rows, indent=2, ensure_ascii=False) + "\n").encode())


def _plain(value: float | str) -> float | str | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value
