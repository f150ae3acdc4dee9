"""Run a recursion in CasADi's virtual machine: needs no compiler; the reference for all others."""

from collections.abc import Callable, Sequence

import numpy as np

from backsight.engine.recursion import Recursion
from backsight.types import Array

BLOCK = 500
"""Samples per call: CasADi takes ten times as long to build one of 1000 as one of 500."""

MOST_NUMBERS = 10**7
"""In the memories after all samples of a call, which the virtual machine keeps."""


def run(
    recursion: Recursion,
    data: Sequence[Array],
    *,
    carry: Array,
    progress: Callable[[int], None] = lambda _: None,
    block: int | None = None,
) -> tuple[Array, list[Array]]:
    """Apply the step to every sample.

    Parameters
    ----------
    recursion : Recursion
    data : sequence of (n, m_i) arrays
        One row per sample.
    carry : (nc,) array
        The memory before the first of these samples.
    progress : callable
        Told the number of samples done.
    block : int, optional
        Samples per call of the virtual machine, at most `BLOCK` by default; does not change the
        result.

    Returns
    -------
    carry : (nc,) array
        The memory after the last sample.
    outputs : list of (n, l_j) arrays
    """
    n, block = len(data[0]), block or max(1, min(BLOCK, MOST_NUMBERS // max(len(carry), 1)))
    outputs = [np.empty((n, size)) for size in recursion.output_sizes]
    steps = {size: recursion.step.mapaccum(size) for size in {min(block, n), n % block} - {0}}
    for start in range(0, n, block):
        part = slice(start, min(start + block, n))
        size = part.stop - part.start
        results = steps[size].call([carry, *(d[part].T for d in data)])
        carry = np.asarray(results[0])[:, -1]
        for output, result in zip(outputs, results[1:], strict=True):
            output[part] = np.asarray(result).T
        progress(part.stop)
    return carry, outputs


class Stepper:
    """A recursion that is applied to one sample after the other, as they come.

    Parameters
    ----------
    recursion : Recursion
    """

    def __init__(self, recursion: Recursion) -> None:
        self._step = recursion.step
        self.carry = np.array(recursion.carry0, dtype=float)
        """The memory (nc,) before the coming sample."""

    def step(self, data: Sequence[Array]) -> list[Array]:
        """Apply the step to the data (m_i,) of one sample and return its outputs (l_j,)."""
        carry, *outputs = self._step.call([self.carry, *data])
        self.carry = np.array(carry, dtype=float)[:, 0]
        return [np.asarray(output)[:, 0] for output in outputs]
