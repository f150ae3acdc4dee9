"""Where a fleet keeps its rows: an SQLite file, in which a row is whole or not there.

Only the process that drives the fleet writes to it. The journal is the one that works on disks of
a network, too, and every landing waits until it would survive a power cut.
"""

import contextlib
import dataclasses
import errno
import importlib.metadata
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from backsight.errors import DataError, OutputError
from backsight.fleet.rows.landed import Landed
from backsight.fleet.rows.numbers import Told, row_of_text, row_text
from backsight.output import folder_entries, holding, make_folder, tidy, writing

ROWS, RESULTS = "fleet.sqlite", "results"
"""The file with the rows, and the folder of the results that are kept."""

OURS = 0x4253_464C
"""Application number of SQLite files of fleets: BSFL."""

_TABLES = """
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE items (item TEXT PRIMARY KEY, digest TEXT NOT NULL, stamp TEXT NOT NULL)
    WITHOUT ROWID;
CREATE TABLE rows (item TEXT, estimator TEXT, row TEXT NOT NULL, PRIMARY KEY (item, estimator))
    WITHOUT ROWID;
CREATE TABLE recordings (recording INTEGER PRIMARY KEY, told TEXT NOT NULL);
CREATE TABLE settings (setting INTEGER PRIMARY KEY, told TEXT NOT NULL);
CREATE TABLE catalogue (number INTEGER PRIMARY KEY, item TEXT NOT NULL, recording INTEGER NOT NULL,
    setting INTEGER NOT NULL);
CREATE INDEX by_item ON catalogue (item);
"""


@dataclasses.dataclass(frozen=True)
class Known:
    """What a store knows of the data of an item."""

    digest: str
    stamp: str


@dataclasses.dataclass(frozen=True)
class Entry:
    """A row with what it is about.

    Parameters
    ----------
    item : str
    recording : dict
        ``name``, ``path``, ``changes`` and ``metadata`` of the recording.
    setting : dict
        Key of the sweep to its value.
    estimator : str
    row : dict
    """

    item: str
    recording: Mapping[str, Any]
    setting: Mapping[str, Any]
    estimator: str
    row: Told


class FleetStore:
    """Rows of a fleet; see `opened_fleet_store` for writing and `reading_store` for reading."""

    def __init__(self, folder: Path, connection: sqlite3.Connection) -> None:
        self.folder, self._connection = folder, connection

    @property
    def about(self) -> dict[str, Any]:
        """What the fleet is."""
        found = self._connection.execute("SELECT name, value FROM about").fetchall()
        return {name: json.loads(value) for name, value in found}

    def tell(self, about: Mapping[str, Any]) -> None:
        """Keep what the fleet is."""
        told = [(name, json.dumps(value, default=str)) for name, value in about.items()]
        with _writing_rows(self.folder), self._connection:
            self._connection.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", told)

    def known(self) -> dict[str, Known]:
        """Every item that is done, with what is known of its data."""
        found = self._connection.execute("SELECT item, digest, stamp FROM items")
        return {item: Known(digest, stamp) for item, digest, stamp in found}

    def land(self, landed: Sequence[Landed]) -> None:
        """Keep what came out of some recordings: all of it or nothing."""
        items = [(one.item, one.digest, stamp_text(one.stamp)) for one in landed]
        rows = [(one.item, name, row_text(row)) for one in landed for name, row in one.rows.items()]
        old = [(one.item,) for one in landed if one.rows]
        with _writing_rows(self.folder), self._connection:
            self._connection.executemany("DELETE FROM rows WHERE item = ?", old)
            self._connection.executemany("INSERT INTO rows VALUES (?, ?, ?)", rows)
            self._connection.executemany("INSERT OR REPLACE INTO items VALUES (?, ?, ?)", items)

    def catalogue(
        self,
        recordings: Sequence[Mapping[str, Any]],
        settings: Sequence[Mapping[str, Any]],
        items: Iterable[tuple[str, int, int]],
    ) -> None:
        """Keep which recordings and settings the fleet has now, and the items made of them."""
        tables = {"recordings": recordings, "settings": settings}
        with _writing_rows(self.folder), self._connection:
            for name, told in tables.items():
                self._connection.execute(f"DELETE FROM {name}")
                self._connection.executemany(
                    f"INSERT INTO {name} VALUES (?, ?)",
                    ((k, json.dumps(one, default=str)) for k, one in enumerate(told)),
                )
            self._connection.execute("DELETE FROM catalogue")
            self._connection.executemany(
                "INSERT INTO catalogue VALUES (?, ?, ?, ?)",
                ((k, *one) for k, one in enumerate(items)),
            )

    def rows(self) -> Iterator[Entry]:
        """Every row of what is in the fleet now, in its order."""
        recordings, settings = (
            [json.loads(told) for (told,) in self._connection.execute(f"SELECT told FROM {name}")]
            for name in ("recordings", "settings")
        )
        found = self._connection.execute(
            "SELECT item, recording, setting, estimator, row FROM catalogue JOIN rows USING (item) "
            "ORDER BY number"
        )
        for item, recording, setting, estimator, row in found:
            yield Entry(item, recordings[recording], settings[setting], estimator, row_of_text(row))

    def entry(self, item: str) -> tuple[dict[str, Any], dict[str, Any]] | None:
        """Recording and setting of an item of the fleet; None if there is no such item."""
        found = self._connection.execute(
            "SELECT recordings.told, settings.told FROM catalogue JOIN recordings USING (recording)"
            " JOIN settings USING (setting) WHERE item = ?",
            (item,),
        ).fetchone()
        return None if found is None else (json.loads(found[0]), json.loads(found[1]))

    def missing(self) -> int:
        """Number of items of the fleet that are not done."""
        (count,) = self._connection.execute(
            "SELECT count(*) FROM catalogue WHERE item NOT IN (SELECT item FROM items WHERE "
            "digest <> '')"
        ).fetchone()
        return count


def stamp_text(stamp: Sequence[Sequence[int]]) -> str:
    """Stamp of files as it is kept."""
    return json.dumps(stamp)


@contextlib.contextmanager
def _writing_rows(folder: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise OutputError(
            f"cannot write to the folder '{folder}': {_reason(error, folder)}"
        ) from error


def _reason(error: sqlite3.Error, folder: Path) -> str:
    """Say it as the system does where SQLite does not say why."""
    match getattr(error, "sqlite_errorcode", 0) & 0xFF:  # the rest is where in SQLite it was
        case sqlite3.SQLITE_FULL:
            return "the disk is full"
        case sqlite3.SQLITE_IOERR:
            return os.strerror(errno.EIO)
        case sqlite3.SQLITE_CANTOPEN:
            try:
                (folder / ROWS).open("ab").close()
            except OSError as why:
                return str(why.strerror)
    return str(error)


@contextlib.contextmanager
def opened_fleet_store(out: Path, *, said: str, about: Mapping[str, Any]) -> Iterator[FleetStore]:
    """Open the store of a fleet for writing, alone.

    Parameters
    ----------
    out : Path
        Folder; missing ones are made.
    said : str
        Digest of the fleet; a store of another one is refused.
    about : dict
        What the fleet is, kept with it.

    Raises
    ------
    OutputError
        If another process writes to it, it holds something else, was begun by another version, or
        cannot be written.
    """
    with writing(out):
        make_folder(out)
    with holding(out):
        fresh = not (out / ROWS).exists()
        if fresh:
            _check_empty(out)
        with contextlib.closing(_connected(out)) as connection, _writing_rows(out):
            store = FleetStore(out, connection)
            version = importlib.metadata.version("backsight")
            if connection.execute("PRAGMA application_id").fetchone() == (0,):
                _begin(connection, out)
                store.tell({"version": version, "of": said})
            _check_same_fleet(store, said, version)
            store.tell(about)
            with writing(out):
                tidy(out)
                tidy(out / RESULTS)  # of a worker that was killed
            yield store


def _check_empty(out: Path) -> None:
    if foreign := folder_entries(out):
        raise OutputError(
            f"'{out}' has files that are not from here, such as {foreign[0]}; choose another folder"
        )


def _connected(out: Path) -> sqlite3.Connection:
    with _writing_rows(out), contextlib.ExitStack() as opened, _not_ours(out):
        connection = sqlite3.connect(out / ROWS, timeout=30.0)
        opened.callback(connection.close)
        connection.execute("PRAGMA journal_mode = DELETE")
        connection.execute("PRAGMA synchronous = EXTRA")
        opened.pop_all()
    return connection


@contextlib.contextmanager
def _not_ours(out: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.OperationalError:
        raise  # the disk, not what is on it
    except sqlite3.DatabaseError as error:
        raise OutputError(f"'{out / ROWS}' is not from here ({error})") from None


def _begin(connection: sqlite3.Connection, out: Path) -> None:
    with _not_ours(out):
        tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if tables != (0,):
        raise OutputError(f"'{out / ROWS}' is not from here; choose another folder")
    # One transaction: a process that is killed here leaves an empty file behind.
    connection.executescript(f"BEGIN; {_TABLES} PRAGMA application_id = {OURS}; COMMIT;")


def _check_same_fleet(store: FleetStore, said: str, version: str) -> None:
    with _not_ours(store.folder):
        about = store.about
    if about.get("version", version) != version:
        raise OutputError(
            f"'{store.folder}' was begun with version {about['version']} of Backsight, this is "
            f"{version}; go on with the same one, or choose another folder"
        )
    if about.get("of", said) != said:
        raise OutputError(
            f"'{store.folder}' holds another fleet: model, estimators, columns, the keys of the "
            "sweep or what is kept are different; choose another folder"
        )
    if "of" not in about:  # killed before it was said
        store.tell({"version": version, "of": said})


@contextlib.contextmanager
def reading_store(folder: Path) -> Iterator[FleetStore]:
    """Open the store of a fleet for reading, also while it is written.

    Raises
    ------
    DataError
        If there is none.
    """
    path = folder / ROWS
    if not path.is_file():
        raise DataError(f"'{folder}' is not the folder of a fleet: it has no {ROWS}")
    try:
        address = f"{path.absolute().as_uri()}?mode=ro"
        with contextlib.closing(sqlite3.connect(address, uri=True, timeout=30.0)) as connection:
            if connection.execute("PRAGMA application_id").fetchone() != (OURS,):
                raise DataError(f"'{path}' is not from here")
            yield FleetStore(folder, connection)
    except sqlite3.Error as error:
        raise DataError(f"'{path}' cannot be read: {error}") from None
