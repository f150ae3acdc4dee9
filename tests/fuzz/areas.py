"""The areas that are tried, by their names."""

from pathlib import Path

from tests.fuzz import expressions, fleets, payloads, problems, recordings
from tests.fuzz.isolated import Area

MAKERS = {
    "problems": problems.area,
    "texts": lambda folder: problems.area(folder, raw=True),
    "expressions": lambda _: expressions.area(),
    "recordings": recordings.area,
    "payloads": lambda _: payloads.area(),
    "fleets": fleets.area,
}

NAMES = tuple(MAKERS)


def area(name: str, folder: Path) -> Area:
    """An area, whose files are in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    return MAKERS[name](folder)
