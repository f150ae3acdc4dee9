"""Write docs/names.md: every public name by namespace, from the package itself."""

import inspect
import re
from pathlib import Path
from types import ModuleType

import backsight as bs

MATH = re.compile(r":math:`([^`]*)`")
PAGE = Path(__file__).with_name("names.md")

HEAD = """# Names

`import backsight as bs` has models, estimators and verbs; the rest is in namespaces.
"""


def names(module: ModuleType) -> list[str]:
    """Public names of a namespace, modules aside; classes first."""
    found = [n for n in dir(module) if not n.startswith("_") and ours(getattr(module, n))]
    return sorted(found, key=lambda n: (n.islower(), n.lower()))


def ours(value: object) -> bool:
    """Neither a module nor imported from elsewhere for a module's own use."""
    here = getattr(value, "__module__", "backsight")
    return not inspect.ismodule(value) and str(here).startswith("backsight")


def is_module(module: ModuleType, name: str) -> bool:
    """Whether a name is that of a namespace."""
    return inspect.ismodule(getattr(module, name))


def first_line(value: object) -> str:
    """What the docstring says first; of a constant, its type."""
    if inspect.isroutine(value) or inspect.isclass(value):
        text = " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
        return MATH.sub(r"$\1$", text).replace("|", r"\|")
    return f"constant, `{type(value).__name__}`"


def spaces() -> dict[str, ModuleType]:
    """The package and its namespaces, by the names under which they are used."""
    inner = {f"bs.{n}": getattr(bs, n) for n in sorted(bs._HOMES) if is_module(bs, n)}
    return {"bs": bs} | inner


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for space, module in spaces().items():
        about = "" if module is bs else f"\n{first_line_of_module(module)}\n"
        rows = [f"| `{n}` | {first_line(getattr(module, n))} |" for n in names(module)]
        parts.append(f"## `{space}`\n{about}\n| name | |\n|---|---|\n" + "\n".join(rows) + "\n")
    return "\n".join(parts)


def first_line_of_module(module: ModuleType) -> str:
    """What a namespace is for."""
    return (inspect.getdoc(module) or "").partition("\n")[0]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
