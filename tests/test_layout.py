"""What every file of the project keeps to: its length, its words, its documentation."""

import ast
import collections
import functools
import inspect
import re
from pathlib import Path

import backsight
from backsight.description import words
from backsight.engine.execute import Engine
from backsight.estimators import ESTIMATORS

ROOT = Path(__file__).parent.parent
SOURCES = sorted((ROOT / "src" / "backsight").rglob("*.py"))
TEXTS = sorted(
    path
    for folder in ("src", "studies", "tests", "docs", "examples", "benchmarks")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".py", ".md", ".toml", ".html", ".css", ".js"}
    and not any(part.endswith(".egg-info") for part in path.parts)
)
LONGEST = 300
MOST_FILES = 12
"""In a folder of the package, beside its `__init__`."""

MOST_OF_ONE_PREFIX = 4
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


@functools.cache
def project() -> list[Path]:
    """Python files of the project; the package, its studies, what tries it and shows it."""
    folders = ("src/backsight", "studies/backsight_studies", "tests", "examples", "benchmarks")
    return sorted(file for folder in folders for file in (ROOT / folder).rglob("*.py"))


@functools.cache
def tables() -> list[Path]:
    """What packages hand on when it is used first."""
    return sorted((ROOT / "src" / "backsight").rglob("__init__.pyi"))


def module_of(file: Path) -> str:
    """Dotted name."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part not in ("src", "studies", "__init__"))


@functools.cache
def tree_of(file: Path) -> ast.Module:
    """Syntax of a file; read once for all tests."""
    return ast.parse(file.read_text(encoding="utf-8"))


@functools.cache
def imports() -> dict[str, set[Path]]:
    """Module of the package to the files, all but the tests, that import it or something of it."""
    users: dict[str, set[Path]] = {module_of(file): set() for file in SOURCES}
    for file in (*project(), *tables()):
        if ROOT / "tests" in file.parents:
            continue
        for node in ast.walk(tree_of(file)):
            if isinstance(node, ast.ImportFrom) and node.module:
                for name in {f"{node.module}.{a.name}" for a in node.names} | {node.module}:
                    users.get(name, set()).add(file)
    return users


def test_files_are_short_and_say_what_they_are():
    texts = {p: p.read_text(encoding="utf-8") for p in project()}
    assert not [str(p) for p, text in texts.items() if len(text.splitlines()) > LONGEST]
    assert not [str(p) for p in SOURCES if not texts[p].startswith(('"""', 'r"""'))]


def test_folders_hold_about_a_dozen_files():
    counts = collections.Counter(f.parent for f in SOURCES if f.name != "__init__.py")
    assert not {str(f.relative_to(ROOT)): n for f, n in counts.items() if n > MOST_FILES}


def test_files_of_one_prefix_are_a_folder():
    prefixes = collections.Counter(
        (str(f.parent.relative_to(ROOT)), f.stem.lstrip("_").partition("_")[0])
        for f in project()
        if ROOT / "tests" not in f.parents
    )
    assert not {key: n for key, n in prefixes.items() if n > MOST_OF_ONE_PREFIX}


def test_private_modules_are_imported_in_their_folder_only():
    private = {module_of(f): f.parent for f in SOURCES if re.fullmatch(r"_[a-z0-9].*", f.stem)}
    users = imports()
    found = {m: {u for u in users[m] if home not in u.parents} for m, home in private.items()}
    assert not {m: sorted(map(str, outside)) for m, outside in found.items() if outside}


def test_modules_that_only_their_folder_uses_are_private():
    """A module is for others if one of them imports it, or the folder offers what is in it."""
    wrong = []
    for module, users in imports().items():
        file = ROOT / "src" / Path(*module.split(".")).with_suffix(".py")
        if not file.is_file() or file.stem.startswith("_") or file.parent.name == "backsight":
            continue
        offered = not users.isdisjoint(file.with_name(f"__init__.{end}") for end in ("py", "pyi"))
        if not offered and all(file.parent in user.parents for user in users):
            wrong.append(module)
    assert not wrong


def is_door(tree: ast.Module) -> bool:
    """Whether a module only hands on names, under the same names."""
    return all(isinstance(node, ast.ImportFrom) for node in tree.body[1:])


def test_nobody_outside_knows_a_method():
    """What the rest of the package needs of an estimator is a property or an abstract class.

    A method is the folder in which an estimator of the table is. Modules that hand on names may
    import from it, and the cases of the contract.
    """
    methods = {".".join(kind.__module__.split(".")[:3]) for kind in ESTIMATORS.values()}
    classes = {kind.__name__ for kind in ESTIMATORS.values()}
    home, cases = ROOT / "src" / "backsight" / "estimators", "backsight.testing._own"
    wrong = []
    for file in SOURCES:
        tree = tree_of(file)
        if home in file.parents or module_of(file) == cases or is_door(tree):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("backsight"):
                named = {f"{node.module}.{a.name}" for a in node.names}
                inside = {n for n in named for m in methods if f"{n}.".startswith(f"{m}.")}
                classy = {n for n in named if n.rpartition(".")[2] in classes}
                wrong += [(module_of(file), name) for name in sorted(inside | classy)]
    assert not wrong


def test_no_name_means_two_things():
    """Classes and public functions of modules: one name, one thing; engines answer alike."""
    alike = {f"backsight.engine.{engine}" for engine in words(Engine)}
    homes: dict[str, list[str]] = {}
    for file in SOURCES:
        for node in tree_of(file).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(module_of(file))
    twice = {name: set(modules) for name, modules in homes.items() if len(modules) > 1}
    assert not {name: modules for name, modules in twice.items() if not modules <= alike}


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


def test_no_two_test_files_have_one_name():
    """Tests are no packages: pytest would take the second for the first."""
    names = [file.name for file in (ROOT / "tests").rglob("test_*.py")]
    assert len(names) == len(set(names))
