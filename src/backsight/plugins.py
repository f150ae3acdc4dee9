"""What other distributions bring, by entry points: estimators, models, readers and studies.

An extension declares in its ``pyproject.toml``, for example,

.. code-block:: toml

    [project.entry-points."backsight.estimators"]
    hinf = "backsight_hinf:HInfinity"

Its names are known without importing it; it is imported when one of them is used first, so that an
extension that is broken says so there, and costs nobody else anything.
"""

import contextlib
import dataclasses
import difflib
import functools
import importlib.metadata
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Generic, TypeVar

from backsight.errors import BacksightError, PluginError, nearest

T = TypeVar("T")

EntryPoint = importlib.metadata.EntryPoint

ALIKE = 0.6
"""From here on a name is one of ours with a slip, and no extension need be thought of."""


def entry_points(group: str) -> list[EntryPoint]:
    """Entry points of a group of all installed distributions, ordered by distribution and name."""
    return list(_installed(group, tuple(map(_as_it_is, sys.path))))


@functools.lru_cache(maxsize=16)
def _installed(group: str, of: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    """Read the entry points of all distributions, which takes some 20 ms, once per `of`."""
    del of
    found = importlib.metadata.entry_points(group=group)
    return tuple(sorted(found, key=lambda e: (maker(e), e.name)))


def _as_it_is(folder: str) -> tuple[str, int]:
    """A folder of modules and when something was put into it or taken out last."""
    place = os.path.abspath(folder)
    try:
        return place, os.stat(place).st_mtime_ns
    except OSError:
        return place, 0


def maker(entry: EntryPoint) -> str:
    """Name and version of the distribution of an entry point."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unnamed distribution"


def unknown(name: str, known: Iterable[str], *, group: str) -> str:
    """Hint at what is meant by a name that is not there: one of those known, or an extension's."""
    names = sorted(known)
    if difflib.get_close_matches(name, names, n=1, cutoff=ALIKE):
        return nearest(name, names)
    listed = nearest("", names)
    return f"{listed}; if an extension brings '{name}' (entry points '{group}'), pip install it"


def load_entry(entry: EntryPoint, what: str) -> object:
    """Import what an entry point names.

    Raises
    ------
    PluginError
        If that fails in any way, with the distribution and the reason.
    """
    try:
        return entry.load()
    # A module may fail, or try to leave, in any way when it is imported.
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"the {what} '{entry.name}' of {maker(entry)} cannot be loaded from '{entry.value}': "
            f"{_reason(error)}; mend or uninstall {maker(entry)}"
        ) from error


@dataclasses.dataclass(frozen=True, eq=False)
class Extended(Mapping[str, T], Generic[T]):
    """Our own table, followed by what extensions bring.

    To iterate and to ask whether a key is there imports nothing.

    Parameters
    ----------
    group : str
        Of the entry points; their names are the keys.
    what : str
        What the entries are, for messages.
    own : mapping
        Our own entries; a key of these cannot be taken.
    adopt : callable
        ``(key, what the entry point names) -> entry``; raises a `BacksightError` that says what is
        wrong with it.
    prefix : str
        Of the keys before the names of the entry points.
    """

    group: str
    what: str
    own: Mapping[str, T]
    adopt: Callable[[str, object], T]
    prefix: str = ""

    def __iter__(self) -> Iterator[str]:
        yield from self.own
        yield from (key for key in self._brought() if key not in self.own)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, key: object) -> bool:
        return key in self.own or key in self._brought()

    def __getitem__(self, key: str) -> T:
        if key in self.own:
            return self.own[key]
        found = self._brought()[key]
        if len(found) > 1:
            raise PluginError(
                f"the {self.what} '{key}' is brought by {' and by '.join(map(maker, found))}; "
                f"uninstall one of them"
            )
        loaded = load_entry(found[0], self.what)
        try:
            return self.adopt(key, loaded)
        except Exception as error:
            raise PluginError(
                f"the {self.what} '{key}' of {maker(found[0])} cannot be used: {_reason(error)}"
            ) from error

    def hint(self, key: str) -> str:
        """What may be meant by a key that is not there."""
        return unknown(key, self, group=self.group)

    def maker(self, key: str) -> str | None:
        """Distribution that brings an entry, None of our own."""
        return None if key in self.own else maker(self._brought()[key][0])

    @contextlib.contextmanager
    def blamed(self, key: str, *, but: tuple[type[Exception], ...] = ()) -> Iterator[None]:
        """Turn errors that are no sentences into sentences, in a block that runs an extension.

        Errors of the kinds `but` are what the caller expects, and go through.

        Raises
        ------
        PluginError
            If the block raises anything but a `BacksightError`, and the entry is not our own.
        """
        try:
            yield
        except (BacksightError, *but):
            raise
        except Exception as error:
            if key in self.own or key not in self:
                raise
            raise PluginError(
                f"the {self.what} '{key}' of {self.maker(key)} failed: {_reason(error)}"
            ) from error

    def refusals(self) -> list[str]:
        """Sentences about the entries that are not used because their key is one of ours."""
        return [
            f"the {self.what} '{key}' of {maker(entry)} is not used: '{key}' is backsight's "
            f"{_name(self.own[key])}; it needs another key"
            for key, entries in self._brought().items()
            if key in self.own
            for entry in entries
        ]

    def _brought(self) -> dict[str, list[EntryPoint]]:
        found: dict[str, list[EntryPoint]] = {}
        for entry in entry_points(self.group):
            found.setdefault(self.prefix + entry.name, []).append(entry)
        return found


def _reason(error: BaseException) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, BacksightError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _name(entry: object) -> str:
    return getattr(entry, "__name__", str(entry))
