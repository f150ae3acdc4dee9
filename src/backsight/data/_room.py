"""Whether what a file claims to hold fits into memory, and into the file; asked before reading."""

import contextlib

from backsight.errors import DataError

COPIES = 4
"""Times that a column is in memory at most: as read, as numbers, in its group, checked."""

_DENSEST = 2000
"""Bytes of measurements that a byte of a file stands for at most; deflate reaches 1032."""

_SMALL = 1 << 26  # bytes; so much may come of nothing


def check_room(claimed: int, what: str) -> None:
    """Raise `DataError` if so many bytes of measurements would not fit into memory."""
    if claimed <= _SMALL:
        return
    needed, available = COPIES * claimed, _available()
    if needed > max(available, _SMALL):
        raise DataError(
            f"{what} claims {_size(claimed)}, for which {_size(needed)} of memory are needed, but "
            f"only {_size(available)} are free; cut the recording"
        )


def check_density(claimed: int, stored: int, what: str) -> None:
    """Raise `DataError` if measurements would be so much larger than what the file holds of them.

    They would be the fill value of samples that were never written, or made to fill the memory.
    """
    if claimed > _SMALL and claimed > _DENSEST * stored:
        raise DataError(f"{what} claims {_size(claimed)}, but the file holds {_size(stored)} of it")


def _available() -> int:
    """Bytes that this process may still take."""
    import psutil

    free = psutil.virtual_memory().available
    with contextlib.suppress(ImportError, OSError):  # Windows has no such limits
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            return min(free, max(limit - psutil.Process().memory_info().vms, 0))
    return free


def _size(count: int) -> str:
    for unit, size in (("TB", 10**12), ("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count} bytes"
