"""Print what the tests of `make coverage` do not get to, and write it down for docs/promises.md."""

import argparse
import json
import tempfile
from pathlib import Path

import coverage

RECORD = Path(__file__).parent / "measured" / "coverage.json"

DRAWING = "plot"
"""Folder of what is looked at and not measured."""

LOW = 90.0
"""Percent below which a file is named."""


def files_of(data: Path) -> dict[str, dict]:
    """Totals of every file of the package, by its path in it."""
    with tempfile.TemporaryDirectory() as folder:
        measured = coverage.Coverage(data_file=str(data), branch=True)
        measured.load()
        target = Path(folder, "all.json")
        measured.json_report(outfile=str(target), ignore_errors=True)
        found = json.loads(target.read_text(encoding="utf-8"))["files"]
    return {name.partition("backsight/")[2]: f["summary"] for name, f in found.items()}


def shares(files: dict[str, dict]) -> dict[str, float]:
    """Percent of statements and of branches that tests get to."""
    both = {}
    for what, name, total in (
        ("statements", "covered_lines", "num_statements"),
        ("branches", "covered_branches", "num_branches"),
    ):
        count = sum(f[total] for f in files.values())
        both[what] = round(100 * sum(f[name] for f in files.values()) / count, 2)
    return both


def main() -> None:
    """Print and record."""
    asked = argparse.ArgumentParser(prog="python tests/covered.py")
    asked.add_argument("data", type=Path)
    given = asked.parse_args()
    files = {n: f for n, f in files_of(given.data).items() if not n.startswith(f"{DRAWING}/")}
    low = {n: f for n, f in files.items() if f["percent_covered"] < LOW}
    for name, f in sorted(low.items(), key=lambda item: item[1]["percent_covered"]):
        print(f"{f['percent_covered']:5.1f} %  {f['missing_lines']:4d} lines  {name}")
    found = shares(files) | {"files": len(files), "below": len(low)}
    print(f"outside of drawing: {found}")
    RECORD.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
