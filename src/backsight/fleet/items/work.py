"""What is handed out and what comes back: paths and settings out, rows in, no data."""

import dataclasses
import importlib.metadata

from backsight.fleet._changes import Changes
from backsight.fleet._recordings import FleetRecording
from backsight.run.estimation import Outputs


@dataclasses.dataclass(frozen=True)
class Item:
    """A recording of a piece of work.

    Parameters
    ----------
    item : str
        Name of the recording with the setting, see `item_of`.
    listed : FleetRecording
    known : str
        Digest of the data of the row that is there; empty if there is none.
    """

    item: str
    listed: FleetRecording
    known: str = ""


@dataclasses.dataclass(frozen=True)
class Work:
    """Some recordings with one setting.

    Parameters
    ----------
    version : str
        Of the package that asks for it.
    text, file : str
        Problem file as it was read, and where.
    setting : tuple of (key, value)
        What the sweep puts into it.
    pieces : tuple of Item
    keep : Outputs, optional
        What is written of every result, into the folder `results`.
    results : str
    outside, env : tuple of str
        As of `backsight run`.
    """

    version: str
    text: str
    file: str
    setting: Changes
    pieces: tuple[Item, ...]
    keep: Outputs | None
    results: str
    outside: tuple[str, ...] = ()
    env: tuple[str, ...] = ()


def version_here() -> str:
    """Version of the package in this process."""
    return importlib.metadata.version("backsight")
