"""Results of the filters of `believing`, made once."""

from collections.abc import Callable
from functools import cache

import pytest
import xarray as xr

from analysis import believing


@pytest.fixture(scope="session")
def believing_results() -> Callable[..., list[xr.Dataset]]:
    """``believing.results``, remembered."""
    return cache(believing.results)
