"""What every study is."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

from backsight_studies.checks import Check


@dataclasses.dataclass(frozen=True)
class Findings:
    """What a study wrote; prints itself as a summary.

    Parameters
    ----------
    page : Path
        The page to read first.
    checks : tuple of Check
        The contents of ``checks.json``.
    summary : str
        A few lines.
    """

    page: Path
    checks: tuple[Check, ...]
    summary: str

    def __str__(self) -> str:
        return self.summary


@dataclasses.dataclass(frozen=True)
class Study:
    """A paper or a real system, worked through.

    Parameters
    ----------
    name : str
        On the command line.
    title : str
        One line.
    run : callable
        ``(out, *, seeds, recordings, progress, force) -> Findings``: writes everything into the
        folder `out`, in which it replaces files of others only with `force`. `seeds` are those of
        the simulated recordings, `recordings` paths of more of them, `progress` is told what is
        being done and the share of the work that is done, 0 to 1.
    seeds : int
        How many of them there are on the command line if it does not say.
    """

    name: str
    title: str
    run: Callable[..., Findings]
    seeds: int = 3
