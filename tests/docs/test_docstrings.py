"""Examples in docstrings run, and show what they say."""

import doctest
import importlib
import inspect
import pkgutil
import re

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


def spaces():
    """Namespaces of models, estimators and verbs; the others have pages of their own."""
    left_out = ("data", "errors", "extend", "plot", "testing")
    inner = [n for n in sorted(backsight._HOMES) if inspect.ismodule(getattr(backsight, n))]
    return [backsight, *(getattr(backsight, n) for n in inner if n not in left_out)]


def public():
    """Classes and functions of the package in these namespaces, each once."""
    found = {}
    for space in spaces():
        for name in dir(space):
            value = getattr(space, name)
            here = getattr(value, "__module__", "").startswith("backsight")
            if not name.startswith("_") and here and (inspect.isclass(value) or callable(value)):
                found.setdefault(id(value), value)
    return list(found.values())


def returned(values):
    """Names of the classes that functions return or that are inside: their examples show them."""
    functions = [inspect.unwrap(v) for v in values if not inspect.isclass(v)]
    texts = [str(inspect.signature(f).return_annotation) for f in functions]
    names = set(re.findall(r"\w+", " ".join(texts)))
    inside = [str(vars(v).get("__annotations__", "")) for v in values if v.__name__ in names]
    return names | set(re.findall(r"\w+", " ".join(inside)))


def test_every_public_name_has_an_example():
    values = public()
    results = returned(values)
    assert len(values) > 100
    lacking = [v.__name__ for v in values if ">>>" not in (v.__doc__ or "")]
    assert not sorted(set(lacking) - results)
