"""The studies as a distribution of their own."""

import importlib.metadata
import tomllib
from pathlib import Path

from backsight_studies import STUDIES

ROOT = Path(__file__).parents[2]


def project(folder: Path) -> dict:
    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_both_are_released_together():
    core, studies = project(ROOT), project(ROOT / "studies")
    assert studies["version"] == core["version"]
    assert f"backsight[plot]=={core['version']}" in studies["dependencies"]
    assert studies["requires-python"] == core["requires-python"]
    licences = [(folder / "LICENSE").read_bytes() for folder in (ROOT, ROOT / "studies")]
    assert licences[0] == licences[1]


def test_they_ask_for_the_same_versions_of_others():
    core = project(ROOT)
    known = {*core["dependencies"], *core["optional-dependencies"]["plot"]}
    asked = set(project(ROOT / "studies")["dependencies"])
    assert {d for d in asked if not d.startswith("backsight")} <= known


def test_the_core_does_without_matplotlib():
    core = project(ROOT)
    assert not [d for d in core["dependencies"] if d.startswith("matplotlib")]


def test_the_entry_point_is_the_table():
    (entry,) = importlib.metadata.entry_points(group="backsight.studies", name="papers")
    assert entry.load() is STUDIES


def test_the_readme_names_every_study():
    text = (ROOT / "studies" / "README.md").read_text(encoding="utf-8")
    assert [line.split("`")[1] for line in text.splitlines() if line.startswith("| `")] == [
        *STUDIES
    ]
