"""Statements of a paper, decided by measured numbers, and the numbers beside them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.checks import Check
from backsight_studies.sheets import write_sheet


@dataclasses.dataclass(frozen=True)
class Claim:
    """A statement of the paper, and whether it holds here.

    Parameters
    ----------
    text : str
    setting : str
        Under which settings it was looked at.
    holds : bool
    measured : str
        The numbers that decide.
    """

    text: str
    setting: str
    holds: bool
    measured: str


def numbers(checks: Sequence[Check]) -> list[Check]:
    """Those that are no statements of the paper."""
    return [c for c in checks if not c.name.startswith("claim")]


def tally(checks: Sequence[Check]) -> str:
    """How many are met, and which are not, as a sentence."""
    failed = [c.name for c in checks if not c.passed]
    missed = f"; not: {'; '.join(failed)}." if failed else "."
    return f"{len(checks) - len(failed)} of {len(checks)} numbers are met{missed}"


def write_claims(claims: Sequence[Claim], out: Path) -> None:
    """Write ``claims.csv``."""
    rows = [[c.text, c.setting, c.holds, c.measured] for c in claims]
    write_sheet(out / "claims.csv", ["claim", "setting", "holds", "measured"], rows)
