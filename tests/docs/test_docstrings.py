"""Examples in docstrings run, and show what they say."""

import doctest
import importlib
import pkgutil

import pytest

import backsight

WITH_EXAMPLES = [
    name
    for _, name, _ in pkgutil.walk_packages(backsight.__path__, "backsight.")
    if "__main__" not in name and ".abi3" not in name and not name.endswith("._backsight")
]


def examples():
    finder = doctest.DocTestFinder(exclude_empty=True)
    for name in WITH_EXAMPLES:
        module = importlib.import_module(name)
        for found in finder.find(module, name):
            if found.examples and found.globs.get("__name__") == name:
                yield pytest.param(found, id=found.name.removeprefix("backsight."))


@pytest.mark.parametrize("example", list(examples()))
def test_every_example_runs(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example.globs.setdefault("bs", backsight)
    options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    failures, tried = doctest.DocTestRunner(optionflags=options, verbose=False).run(example)
    assert tried
    assert not failures
