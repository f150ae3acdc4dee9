"""Replace the inputs of a recording by their changes from sample to sample."""

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.errors import DataError
from backsight.schema import CHANGE


@checked(DataError)
def increments(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with inputs ``d_u``, for a model from `incremental`.

    Sample k holds u_k - u_{k-1}; before the first sample the input counts as constant.
    """
    u = recording["u"].to_numpy()
    changes = recording.assign(u=(("time", "input"), np.diff(u, axis=0, prepend=u[:1])))
    return changes.assign_coords(input=[f"{CHANGE}{n}" for n in recording["input"].values])
