"""What every study is, and the one way in which all of them are run."""

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Generic, TypeVar, final

from backsight.errors import DataError
from backsight.output import whole, write_whole
from backsight_studies.checks import Check, write_checks

PAGE = "study.html"

Progress = Callable[[str, float], None]
"""Told what is being done and the share of the work that is done, 0 to 1."""

Recordings = Sequence[str | os.PathLike[str]]
"""Paths of recordings."""

E = TypeVar("E")
"""What a study finds, in its own words: its experiment."""


@final
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


@final
@dataclasses.dataclass(frozen=True)
class Written:
    """What is left to write when the tables and figures of a study are in its folder.

    Parameters
    ----------
    checks : sequence of Check
    page : str
        HTML.
    points : sequence of str
        The study in a few sentences.
    """

    checks: Sequence[Check]
    page: str
    points: Sequence[str]


@final
@dataclasses.dataclass(frozen=True)
class Study(Generic[E]):
    """A paper or a real system, worked through.

    Parameters
    ----------
    name : str
        On the command line.
    title : str
        One line.
    carry_out : callable
        ``(seeds, recordings, progress) -> experiment``: simulates with the seeds, reads the
        recordings, estimates. A study that takes no recordings gives `from_seeds` of a function
        of seeds and progress alone.
    write : callable
        ``(experiment, folder) -> Written``: judges the experiment, writes tables and figures into
        the folder, and says what the page and the checks are.
    seeds : int
        How many simulated recordings there are if nobody says: the seeds 0, 1, ...
    """

    name: str
    title: str
    carry_out: Callable[[Sequence[int], Recordings, Progress], E]
    write: Callable[[E, Path], Written]
    seeds: int = 3

    def run(
        self,
        out: str | os.PathLike[str],
        *,
        seeds: Sequence[int] | None = None,
        recordings: Recordings = (),
        progress: Progress = lambda _what, _share: None,
        force: bool = False,
    ) -> Findings:
        """Carry out the study and write its page, tables, figures and ``checks.json``.

        A study may start one process per core; a program that calls this needs the usual
        ``if __name__ == "__main__":``.

        Parameters
        ----------
        out : path
            Folder for the results; made if it does not exist, and as it was if anything fails.
        seeds : sequence of int, optional
            Of the simulated recordings; one that is given twice counts once. If not given, as
            many as the study has of its own.
        recordings : sequence of path
            Further measured ones, in the form that the study reads; most studies take none.
        progress : callable
            Told what is being done and the share of the work that is done, 0 to 1.
        force : bool
            Replace files in the folder that are not from an earlier run.

        Returns
        -------
        Findings

        Raises
        ------
        DataError
            If a seed is negative or there is none where one is needed, or a recording cannot be
            read, is not of this system, or is given to a study that takes none.
        OutputError
            If the folder cannot be written, or holds files of other origin that would be
            replaced; found before the work begins.
        """
        chosen = tuple(dict.fromkeys(range(self.seeds) if seeds is None else seeds))
        if any(seed < 0 for seed in chosen):
            raise _wrong(chosen)
        with whole(out, force=force) as folder:
            written = self.write(self.carry_out(chosen, recordings, progress), folder)
            write_checks(folder / "checks.json", written.checks)
            write_whole(folder / PAGE, written.page.encode())
        progress("", 1.0)
        lines = [self.title, *(f"- {point}" for point in written.points)]
        return Findings(Path(out) / PAGE, tuple(written.checks), "\n".join(lines))


def from_seeds(
    carry_out: Callable[[Sequence[int], Progress], E],
) -> Callable[[Sequence[int], Recordings, Progress], E]:
    """For a study that makes its own recordings: it needs a seed and takes no files."""

    def checked(seeds: Sequence[int], recordings: Recordings, progress: Progress) -> E:
        if recordings:
            raise DataError("the study simulates its own plants: it takes no recordings")
        if not seeds:
            raise _wrong(seeds)
        return carry_out(seeds, progress)

    return checked


def _wrong(seeds: Sequence[int]) -> DataError:
    return DataError(
        f"seeds {list(seeds)}: the study needs a seed that is not negative for every recording "
        "that it simulates"
    )
