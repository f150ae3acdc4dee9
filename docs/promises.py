"""Write docs/promises.md: what is promised, by which tests, and how well these bite."""

import json
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("promises.md")
LISTED = Path(__file__).with_name("promises.toml")
MEASURED = ROOT / "tests" / "measured"
BAR = "\\|"
"""A bar inside a table."""

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
    parts.append("## How well the tests bite\n\n" + "\n".join(_figures()))
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
    if coverage := measured("coverage"):
        parts += [
            f"`make coverage`: {coverage['branches']:.1f} % of the branches and "
            f"{coverage['lines']:.1f} % of the lines of the package, drawing aside, are run by the "
            "fast tests.\n"
        ]
    if lowest := measured("lowest"):
        versions = ", ".join(f"{name} {version}" for name, version in lowest["versions"].items())
        parts += [
            f"`make lowest`: with the oldest versions that are allowed ({versions}) "
            f"{lowest['passed']} tests passed and {lowest['failed']} failed.\n"
        ]
    if fuzz := measured("fuzz"):
        parts += [
            "`make fuzz-long`: changed input, and how much of it led to anything but a result or "
            "one clear line.\n",
            "| area | cases | found |\n|---|---:|---:|",
            *(f"| {name} | {f['cases']} | {f['found']} |" for name, f in fuzz.items()),
            "",
        ]
    if mutants := measured("mutation"):
        parts += _mutants(mutants)
    return parts


def _mutants(found: dict[str, Any]) -> list[str]:
    rows = [
        f"| {area} | {f['known']} | {f['tried']} | "
        f"{100 * f['killed'] / f['tried']:.0f} ± {100 * f['error']:.0f} % |"
        for area, f in found.items()
    ]
    survivors = [
        f"| `{s['file']}:{s['line']}` | `{s['code'].replace('|', BAR)}` | {s['change']} | "
        f"{s.get('reason', s['why'])} |"
        for f in found.values()
        for s in f["survivors"]
    ]
    return [
        "`make mutation`: a sample of all small changes of the program (another operator, "
        "comparison or number, a condition that never holds), and how many of them a test notices. "
        "The error is that of the sample.\n",
        "| area | changes | tried | noticed |\n|---|---:|---:|---:|",
        *rows,
        "\nThose that no test noticed:\n",
        "| place | line | change | |\n|---|---|---|---|",
        *survivors,
        "",
    ]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
