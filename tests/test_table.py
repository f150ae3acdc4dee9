"""Everything that lists the estimators lists all of them, and says enough."""

import dataclasses
import importlib.util
import inspect
import re
from pathlib import Path

import pytest

import backsight as bs
from backsight.estimators import ESTIMATORS

ROOT = Path(__file__).parents[1]
MOST_NAMES = 45
SECTIONS = ("Fields", "Example", r"Limits( of the method)?", "How to tune", "References")


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_estimator_is_in_the_package():
    for estimator in ESTIMATORS.values():
        assert getattr(bs, estimator.__name__) is estimator


@pytest.mark.parametrize("page", ["README.md", "docs/choose.md"])
def test_every_estimator_is_where_one_chooses(page):
    links = re.findall(r"estimators/(\w+)\.md", text(page))
    assert set(links) == set(ESTIMATORS)


@pytest.mark.parametrize("key", ESTIMATORS)
def test_every_page_says_how_it_works_and_how_to_use_it(key):
    estimator, page = ESTIMATORS[key], text(f"docs/estimators/{key}.md")
    sections = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE))
    for wanted in SECTIONS:
        found = [body for name, body in sections.items() if re.fullmatch(wanted, name)]
        assert found, f"docs/estimators/{key}.md has no section '{wanted}'"
        assert all(len(body.split()) > 8 for body in found), f"'{wanted}' of {key}.md is empty"
    assert "$$" in page
    assert f"bs.{estimator.__name__}(" in page.partition("## Example")[2]
    fields = [f.name for f in dataclasses.fields(estimator)]
    missing = [n for n in fields if f"`{n}`" not in sections["Fields"]]
    assert not missing, f"docs/estimators/{key}.md: 'Fields' does not explain {missing}"


def test_the_docstring_of_every_estimator_has_equations_and_sources():
    for estimator in ESTIMATORS.values():
        doc = inspect.getdoc(estimator) or ""
        assert "References\n----------" in doc, estimator.__name__
        assert ":math:" in doc or ".. math::" in doc, estimator.__name__


def test_the_table_of_names_is_what_there_is():
    found = importlib.util.spec_from_file_location("names", ROOT / "docs" / "names.py")
    assert found is not None
    assert found.loader is not None
    names = importlib.util.module_from_spec(found)
    found.loader.exec_module(names)
    assert names.PAGE.read_text(encoding="utf-8") == names.page(), "run docs/names.py"
    assert len(names.names(bs)) <= MOST_NAMES
    lines = [line for line in names.page().splitlines() if line.startswith("| `")]
    assert not [line for line in lines if line.endswith("|  |")], "without a docstring"


def test_the_stub_names_every_namespace():
    for name, module in bs._HOMES.items():
        if module == "backsight":
            assert inspect.ismodule(getattr(bs, name))
            assert inspect.getdoc(getattr(bs, name))
