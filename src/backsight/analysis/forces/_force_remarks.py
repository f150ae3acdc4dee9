"""What is to be said of sparse forces that were, or were not, found."""

import numpy as np
import xarray as xr

from backsight.rounding import significant

REMARKS = "remarks"
"""Attribute of a result: sentences, one per line."""


def force_remarks(result: xr.Dataset) -> list[str]:
    """Say so if a result with the variables of sparse forces contains none, and why.

    Parameters
    ----------
    result : xarray.Dataset
        With ``d_raw``, ``d_hat``, ``nonzeros`` and ``lam_max``; of others nothing is said.
    """
    if not {"d_raw", "d_hat", "nonzeros", "lam_max"} <= set(result.data_vars):
        return []
    largest = {
        name: float(np.nanmax(np.abs(result[name].values), initial=0.0))
        for name in ("d_raw", "d_hat", "nonzeros", "lam_max")
    }
    if not largest["nonzeros"] > 0:
        return [
            "no force was found in the whole recording: lam is at or above lambda_max = "
            f"{significant(largest['lam_max'], 4)}; choose a smaller one (a tenth of it, to begin "
            "with)"
        ]
    if not largest["d_raw"] > 0:
        return ["forces were found, but none at the sample of the output; raise lag"]
    if not largest["d_hat"] > 0:
        return [
            f"all forces that were found, up to {significant(largest['d_raw'], 3)}, are below the "
            "threshold; lower it, or lower lam"
        ]
    return []
