"""Studies: papers and real systems worked through, which extensions bring.

The entry point group ``backsight.studies`` names a study, or several by name.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from backsight.errors import PluginError
from backsight.plugins import entry_points, load_entry, maker

GROUP = "backsight.studies"


@runtime_checkable
class Study(Protocol):
    """What the command line needs of a study."""

    @property
    def name(self) -> str:
        """What it is called on the command line."""
        ...

    @property
    def title(self) -> str:
        """One line."""
        ...

    @property
    def seeds(self) -> int:
        """How many recordings it simulates if nothing else is said."""
        ...

    @property
    def run(self) -> "Run":
        """Do the work."""
        ...


class Run(Protocol):
    """Write everything into a folder; return findings, which have a `page` and print themselves."""

    def __call__(
        self,
        out: Path,
        *,
        seeds: Sequence[int],
        recordings: Sequence[Path],
        progress: Callable[[str, float], None],
        force: bool,
    ) -> Any:
        """See `Run`."""
        ...


def studies(*, tell: Callable[[str], None]) -> dict[str, Study]:
    """Every installed study by its name.

    Parameters
    ----------
    tell : callable
        Told, a sentence at a time, which extensions are broken or refused; the others are found
        all the same.

    Raises
    ------
    PluginError
        If no study is installed.
    """
    entries = entry_points(GROUP)
    if not entries:
        raise PluginError("no studies are installed: pip install backsight-studies")
    found: dict[str, Study] = {}
    makers: dict[str, str] = {}
    for entry in entries:
        try:
            brought = _read(load_entry(entry, "study"))
        except PluginError as error:
            tell(str(error))
            continue
        for study in brought:
            if not isinstance(study, Study):
                tell(f"'{entry.value}' of {maker(entry)} is no study: {study!r}")
            elif study.name in found:
                tell(
                    f"the study '{study.name}' of {maker(entry)} is not used: "
                    f"{makers[study.name]} brings one of that name"
                )
            else:
                found[study.name], makers[study.name] = study, maker(entry)
    return found


def _read(brought: object) -> list[object]:
    return list(brought.values()) if isinstance(brought, Mapping) else [brought]
