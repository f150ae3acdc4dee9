"""Write docs/promises.md: what is promised, and by which tests."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("promises.md")
LISTED = Path(__file__).with_name("promises.toml")
MEASURED = ROOT / "tests" / "measured"
REASONS = ROOT / "tests" / "mutation" / "reasons.toml"
LIVES = ("survived", "no test gets there")

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
            "one clear line; what was found is mended, and tried by every run of the tests.\n",
            "| area | cases | found |\n|---|---:|---:|",
            *(f"| {name} | {f['cases']} | {f['found']} |" for name, f in fuzz.items()),
            "",
        ]
    if covered := measured("coverage"):
        parts += [
            "`make coverage`: the fast tests get to "
            f"{covered['statements']:.1f} % of the statements and {covered['branches']:.1f} % of "
            f"the branches outside of drawing; {covered['below']} of {covered['files']} files are "
            "below 90 %.",
            "",
        ]
    if mutants := measured("mutants"):
        parts += _of_mutants(mutants)
    return parts


def _of_mutants(found: dict[str, Any]) -> list[str]:
    """How many changes were noticed, by area and altogether, and which were not.

    Changes that make no difference are none of what is tried: no test could notice them.
    """
    reasons = tomllib.loads(REASONS.read_text(encoding="utf-8")) if REASONS.exists() else {}
    rows, share, variance = [], 0.0, 0.0
    known = sum(a["known"] for a in found.values())
    alive: list[str] = []
    for name, area in found.items():
        tried = {m: why for m, why in area["tried"].items() if why != "not run"}
        lives = [m.rpartition(" #")[0] for m, why in tried.items() if why in LIVES]
        same = sum(reasons.get(m, "").startswith("same:") for m in lives)
        count, noticed = len(tried) - same, len(tried) - len(lives)
        rows.append(
            f"| {name} | {area['known']} | {len(tried)} | {same} | {noticed} "
            f"| {noticed / count:.0%} |"
        )
        weight = area["known"] / known
        # A share of all or none of few would have no error at all (Agresti and Coull 1998).
        p = (noticed + 2) / (count + 4)
        share += weight * noticed / count
        variance += weight**2 * p * (1 - p) / (count + 4)
        alive += lives
    band = 1.96 * math.sqrt(variance)
    return [
        "`make mutants`: small changes of the program (an operator, a number, a condition, a "
        "call), drawn at random from all of an area, and how many of them the fast tests that get "
        "there notice, of those that change a result (judged by reading what was not noticed); of "
        f"all areas together, each counted by its size, {share:.0%} ± {band:.0%} (95 %). Tests "
        "were added for some that were not noticed at first, so that the share is a little too "
        "good.\n",
        "| area | changes | tried | without effect | noticed | |\n|---|---:|---:|---:|---:|---:|",
        *rows,
        "",
        "What nobody noticed, and why:\n",
        "| change | |\n|---|---|",
        *(f"| `{_cell(m)}` | {reasons.get(m, 'no test yet')} |" for m in sorted(alive)),
        "",
    ]


def _cell(text: str) -> str:
    """Code in a cell of a table."""
    return text.replace("|", "\\|").replace("`", "'")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
