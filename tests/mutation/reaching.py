"""Which tests get to a line: of the run of `make coverage`, which notes them."""

import collections
import contextlib
import sqlite3
from pathlib import Path

import coverage
from tests.mutation.mutants import Mutant

OF_KERNELS = {
    "cs_window": (
        "tests/estimators/test_cs_mhe.py",
        "tests/estimators/test_capped_forces.py",
        "tests/oracles/test_window_limits.py",
        "tests/relations/test_nonlinear_windows.py",
    ),
    "matrix": (
        "tests/estimators/test_many_states.py",
        "tests/engine/test_dense.py",
        "tests/tune/test_filter_by_matrices.py",
    ),
}
"""Tests by folder of kernels; coverage does not see into C."""


class Reached:
    """Tests by the lines that they get to.

    What a test has got to is noted for the first one that does: expressions are kept, and so are
    fixtures. So all other tests of its file may notice a change, too, and come after it.

    Parameters
    ----------
    file : Path
        Data of coverage with tests as contexts.
    """

    def __init__(self, file: Path) -> None:
        self._data = coverage.CoverageData(str(file))
        self._data.read()
        self._lines: dict[Path, dict[int, set[str]]] = {}
        self.known = {n for c in self._data.measured_contexts() if (n := _name(c))}
        self._by_file: dict[str, set[str]] = collections.defaultdict(set)
        for name in self.known:
            self._by_file[name.partition("::")[0]].add(name)
        self.breadth = _breadth(file)
        """How many files of the package a test gets to: what gets to few is about them."""

    def tests(self, mutant: Mutant) -> tuple[set[str], set[str]]:
        """Tests that get to the line of a mutant, and the others of their files.

        Of a line that is only run when its module is imported, those that get to the module.
        """
        if mutant.file.suffix != ".py":
            direct = {n for n in self.known if n.startswith(OF_KERNELS[mutant.file.parent.name])}
        else:
            found = self._at(mutant.file)
            direct = found.get(mutant.line, set()) or set().union(*found.values())
        files = {n.partition("::")[0] for n in direct}
        return direct, {n for f in files for n in self._by_file[f]} - direct

    def _at(self, file: Path) -> dict[int, set[str]]:
        if file not in self._lines:
            lines = self._data.contexts_by_lineno(str(file))
            self._lines[file] = {
                line: names
                for line, contexts in lines.items()
                if (names := {n for c in contexts if (n := _name(c))})
            }
        return self._lines[file]


def _breadth(file: Path) -> dict[str, int]:
    with contextlib.closing(sqlite3.connect(file)) as data:
        rows = data.execute(
            "select context, count(distinct file_id) from arc join context "
            "on context.id = arc.context_id group by context_id"
        ).fetchall()
    found: dict[str, int] = {}
    for context, count in rows:
        found[_name(context)] = max(found.get(_name(context), 0), count)
    return found


def _name(context: str) -> str:
    """The test of a context."""
    return context.partition("|")[0] if "::" in context else ""
