"""Write docs/promises.md: what is promised, and by which tests."""

import json
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("promises.md")
LISTED = Path(__file__).with_name("promises.toml")
MEASURED = ROOT / "tests" / "measured"

HEAD = """# What is promised, and how it is tested

Each promise names the files of `tests/` that break if it does not hold; many of them run over every
estimator, format or command. `make test` runs what is fast, `make test-all` all of it, and the
figures below are written by the commands beside them. [Trust in files](trust.md) says what is not
promised.
"""


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for title, promises in tomllib.loads(LISTED.read_text(encoding="utf-8")).items():
        rows = [f"| {p['promise']} | {'<br>'.join(map(_named, p['tests']))} |" for p in promises]
        parts.append(f"## {title}\n\n| promised | tests |\n|---|---|\n" + "\n".join(rows) + "\n")
    parts.append("## Figures\n\n" + "\n".join(_figures()))
    return "\n".join(parts)


def _named(pattern: str) -> str:
    """A file of tests, or several."""
    if not any(ROOT.glob(pattern)):
        raise ValueError(f"docs/promises.toml: there is no {pattern}")
    return f"`{pattern.removeprefix('tests/')}`"


def measured(name: str) -> Any:
    """Figures that a command has written; None if it has not been run."""
    file = MEASURED / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def _figures() -> list[str]:
    parts = []
    if fuzz := measured("fuzz"):
        parts += [
            "`make fuzz-long`: changed input, and how much of it led to anything but a result or "
            "one clear line.\n",
            "| area | cases | found |\n|---|---:|---:|",
            *(f"| {name} | {f['cases']} | {f['found']} |" for name, f in fuzz.items()),
            "",
        ]
    return parts


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
