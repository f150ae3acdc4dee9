"""Which tests get to a line, and how long they take: of a run with coverage."""

import collections
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import coverage
from tests.mutation.mutants import Mutant

LONGEST = 60.0
"""Seconds of the tests of a mutant, as they took when they were measured."""

PLAIN = re.compile(r"[\w/.\-]+::[\w]+(\[[\w .,\-]*\])?")
"""Names by which pytest finds a test for sure; of others, the function."""


class Reached:
    """Tests by the lines that they get to.

    Parameters
    ----------
    data : list of Path
        Files of coverage, with tests as contexts.
    times : list of Path
        Files of pytest's ``--junitxml``.
    """

    def __init__(self, data: list[Path], times: list[Path]) -> None:
        self._data = []
        for file in data:
            one = coverage.CoverageData(str(file))
            one.read()
            self._data.append(one)
        self._seconds = dict(_seconds(times))
        self._lines: dict[Path, dict[int, list[str]]] = {}

    def tests(self, mutant: Mutant) -> list[str]:
        """Tests that get to a mutant, the quickest first."""
        if mutant.file not in self._lines:
            found: dict[int, list[str]] = collections.defaultdict(list)
            for data in self._data:
                for line, tests in data.contexts_by_lineno(str(mutant.file)).items():
                    found[line] += tests
            self._lines[mutant.file] = found
        contexts = self._lines[mutant.file].get(mutant.line, [])
        return self.quickest({c.partition("|")[0] for c in contexts if "::" in c})

    def quickest(self, names: set[str]) -> list[str]:
        """Names in the order of their times, as many as there is time for."""
        seconds: dict[str, float] = {}
        for name in names:
            taken = self._seconds.get(name, 1.0)
            plain = name if PLAIN.fullmatch(name) else name.partition("[")[0]
            seconds[plain] = seconds.get(plain, 0.0) + taken
        chosen, total = [], 0.0
        for name in sorted(seconds, key=lambda n: seconds[n]):
            total += seconds[name]
            if total > LONGEST and chosen:
                break
            chosen.append(name)
        return chosen


def _seconds(times: list[Path]):
    for file in times:
        for case in ElementTree.parse(file).getroot().iter("testcase"):
            path = (case.get("classname") or "").replace(".", "/") + ".py"
            yield f"{path}::{case.get('name')}", float(case.get("time") or 0.0)
