"""What every file of the project keeps to: its length, its words, its documentation."""

import inspect
import re
from pathlib import Path

import backsight
from backsight.estimators import ESTIMATORS

ROOT = Path(__file__).parent.parent
PACKAGES = (ROOT / "src" / "backsight", ROOT / "studies" / "backsight_studies")
SOURCES = sorted(path for package in PACKAGES for path in package.rglob("*.py"))
TEXTS = sorted(
    path
    for folder in ("src", "studies", "tests", "docs", "examples", "benchmarks")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".py", ".md", ".toml", ".html", ".css", ".js"}
    and not any(part.endswith(".egg-info") for part in path.parts)
)
LONGEST = 300
UNFINISHED = re.compile("|".join(["TO" + "DO", "FIX" + "ME", "X" + "XX", "HA" + "CK"]))


def public(owner: object) -> list[tuple[str, object]]:
    """Names without underscore that are classes, functions or methods of the package."""
    found = []
    for name, value in vars(owner).items():
        if isinstance(value, property):
            value = value.fget
        target = inspect.unwrap(getattr(value, "__func__", value))
        here = getattr(target, "__module__", "").startswith("backsight")
        if not name.startswith("_") and here and callable(target):
            found.append((name, target))
    return found


def test_files_are_short_and_say_what_they_are():
    texts = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in SOURCES}
    assert not [p for p, text in texts.items() if len(text.splitlines()) > LONGEST]
    assert not [p for p, text in texts.items() if not text.startswith(('"""', 'r"""'))]


def test_nothing_is_left_unfinished():
    found = [p for p in TEXTS if UNFINISHED.search(p.read_text(encoding="utf-8"))]
    assert not [str(p.relative_to(ROOT)) for p in found]


def documented(name: str, value: object) -> bool:
    """Whether there is a docstring, and not just the signature that a dataclass makes of itself."""
    text = value.__doc__ or ""
    return bool(text.strip()) and not text.startswith(f"{name}(")


def test_every_public_name_is_documented():
    """Of the package itself: each function, each class with its public methods."""
    names, undocumented = public(backsight), []
    assert names
    for name, value in names:
        if not documented(name, value):
            undocumented.append(name)
        if inspect.isclass(value):
            undocumented += [f"{name}.{m}" for m, f in public(value) if not documented(m, f)]
    assert not undocumented


def test_every_estimator_has_a_page():
    for key, estimator in ESTIMATORS.items():
        page = ROOT / "docs" / "estimators" / f"{key}.md"
        assert page.is_file(), f"{page.relative_to(ROOT)} is missing"
        text = page.read_text(encoding="utf-8")
        assert text.startswith("# ")
        assert estimator.title.lower() in text.lower()
        assert estimator.__name__ in text


def test_every_exported_name_exists():
    for name in getattr(backsight, "__all__", []):
        assert hasattr(backsight, name), name
