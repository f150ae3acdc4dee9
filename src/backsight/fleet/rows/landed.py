"""What comes back of a recording with a setting."""

import dataclasses
from collections.abc import Mapping

from backsight.fleet._recordings import Stamp
from backsight.fleet.rows.numbers import Told


@dataclasses.dataclass(frozen=True)
class Landed:
    """What came out of a recording.

    Parameters
    ----------
    item : str
    digest : str
        Of the data; empty if they could not be read as a whole, so that it is tried again.
    stamp : tuple
        Of the files when they were read.
    rows : dict
        Estimator to row; empty if the digest is the one that is known.
    """

    item: str
    digest: str
    stamp: tuple[Stamp, ...]
    rows: Mapping[str, Told]
