"""What a worker does: read some recordings, run the estimators over them, tell a row of each."""

from backsight.errors import WorkerError
from backsight.fleet.items._estimating import estimate_group
from backsight.fleet.items._reading import Reading, read_item
from backsight.fleet.items.work import Work, version_here
from backsight.fleet.rows import Landed


def done(work: Work) -> tuple[list[Landed], float]:
    """Do a piece of work.

    Returns
    -------
    list of Landed
        In order of the pieces.
    float
        Seconds for a recording, without what has to be made once.

    Raises
    ------
    WorkerError
        If this is another version of the package than the one that asks.
    OutputError
        If results cannot be written.
    """
    here = version_here()
    if here != work.version:
        raise WorkerError(
            f"a worker has version {here} of Backsight, the fleet was started with {work.version}; "
            "install the same one"
        )
    readings = [read_item(piece, work) for piece in work.pieces]
    spent = sum(reading.seconds for reading in readings)
    groups: dict[object, list[Reading]] = {}
    for reading in readings:
        if reading.data is not None:
            groups.setdefault(reading.group, []).append(reading)
    for members in groups.values():
        spent += estimate_group(members, work)
    return [reading.landed() for reading in readings], spent / max(len(readings), 1)
