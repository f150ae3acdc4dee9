"""What header and code of a program in C have in common: names, settings, comments."""

import dataclasses
import re

from backsight.engine.c99.leaf import Precision
from backsight.engine.program import Buffer, Program
from backsight.errors import printable


@dataclasses.dataclass(frozen=True)
class SettingsField:
    """Inputs of a step that are no data: they are kept in a struct and may be changed at any time.

    Parameters
    ----------
    name : str
        Of the program's input, and of the field in C.
    values : tuple of float
        What they are unless somebody changes them.
    labels : tuple of str
        What each is, with its unit.
    """

    name: str
    values: tuple[float, ...]
    labels: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Interface:
    """What is the same in header and code: names, type of numbers, outputs, settings."""

    name: str
    kind: Precision
    results: tuple[str, ...]
    settings: tuple[SettingsField, ...]
    about: str
    begins: bool = False
    """Whether the memory before the first sample follows the settings."""
    aside: bool = False
    """Whether the step is given an array of tables."""

    @property
    def real(self) -> str:
        """Type of a number."""
        return f"{self.name}_real"

    def data(self, program: Program) -> list[Buffer]:
        """Inputs that are data of a sample."""
        kept = {f.name for f in self.settings}
        return [b for b in program.inputs if b.name not in kept]

    def step(self, program: Program) -> str:
        """Declaration of the step."""
        lines = [f"{self.name}_memory *memory", f"{self.name}_workspace *work"]
        lines += [f"const {self.real} *tables"] if self.aside else []
        lines += [f"const {self.name}_settings *settings"] if self.settings else []
        lines += [f"const {self.real} *{b.name}" for b in self.data(program)]
        lines += [f"{self.real} *{r}" for r in self.results]
        joint = ",\n    ".join(lines)
        return f"void {self.name}_step(\n    {joint})"

    @property
    def init(self) -> str:
        """Declaration of what sets the memory."""
        settings = f", const {self.name}_settings *settings" if self.begins else ""
        return f"void {self.name}_init({self.name}_memory *memory{settings})"

    @property
    def defaults(self) -> str:
        """Declaration of what sets the settings."""
        return f"void {self.name}_defaults({self.name}_settings *settings)"


def settings_struct(to: Interface) -> list[str]:
    """The struct of settings, as lines of the header."""
    if not to.settings:
        return []
    lines = ["/* What may be changed here, between two samples, too. */", "typedef struct {"]
    for field in to.settings:
        what = comment("; ".join(field.labels))
        lines += [f"    {what}", f"    {to.real} {field.name}[{len(field.values)}];"]
    return [
        *lines,
        f"}} {to.name}_settings;",
        "",
        "/* Set the settings to the values that were exported. */",
        f"{to.defaults};",
        "",
    ]


def settings_setter(to: Interface) -> list[str]:
    """Definition of what sets the settings."""
    if not to.settings:
        return []
    lines = [to.defaults, "{"]
    for field in to.settings:
        lines += [
            f"    settings->{field.name}[{i}] = {to.kind.typed(v)};"
            for i, v in enumerate(field.values)
        ]
    return ["\n".join([*lines, "}"])]


def comment(text: str) -> str:
    """A comment that ends where it should, whatever is in the text.

    Beside the marks of comments themselves, trigraphs and a backslash at the end of a line could
    join and end it, and writing that turns its direction could show other code than there is.
    """
    lines = []
    for line in text.splitlines():
        plain = re.sub(r"\?(?=\?)", "? ", printable(line))
        lines.append(plain.replace("*/", "* /").replace("/*", "/ *").rstrip(" \t\\"))
    return "/* " + "\n   ".join(lines) + " */"
