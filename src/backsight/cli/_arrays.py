"""What xarray need not import."""

from typing import Any


def numpy_only() -> None:
    """Tell xarray that no array of this process is of dask, pint or cupy.

    It asks that of every variable, and imports each of these packages to find out, which takes half
    a second where they are installed. Without the place where it keeps what it has found nothing is
    lost but that time. Not for a process in which others work, as a notebook is.
    """
    from xarray.namedarray import pycompat

    known: dict[str, Any] = getattr(pycompat, "_cached_duck_array_modules", {})
    kind: Any = getattr(pycompat, "DuckArrayModule", None)
    if kind is None:
        return
    for name in ("dask", "pint", "cupy"):
        absent = kind.__new__(kind)
        absent.module, absent.version, absent.type, absent.available = None, None, (), False
        known.setdefault(name, absent)
