"""Results of estimators that look back, put to the samples that they are about."""

from collections.abc import Sequence

import numpy as np

from backsight.types import Array


def run_on(data: Sequence[Array], lag: int) -> list[Array]:
    """Inputs, outputs and masks with `lag` more samples at the end at which nothing was measured.

    After them the outputs have reached the last sample of the recording. The inputs stay.
    """
    u, y, mask = data
    return [
        np.vstack([u, np.repeat(u[-1:], lag, axis=0)]),
        *(np.vstack([a, np.zeros((lag, a.shape[1]))]) for a in (y, mask)),
    ]


def from_first_sample(outputs: Sequence[Array], lag: int) -> list[Array]:
    """Outputs without those that are about samples before the first."""
    return [output[lag:] for output in outputs]
