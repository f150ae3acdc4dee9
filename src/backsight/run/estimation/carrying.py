"""Carry a recursion over the samples of a recording, and put results to what they are about."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from backsight.engine.execute import run_part
from backsight.engine.recursion import Channel, Recursion
from backsight.run.estimation.results.outputs import Outputs
from backsight.run.estimation.results.values import named
from backsight.types import Array

BLOCK = 4096
"""Samples that are computed, looked at and stored while they are in the processor's cache."""

QUICK = 0.02
"""Seconds for a block within which nobody waits for an interrupt."""

VM_BLOCK = 100_000
"""The virtual machine cuts by itself, and takes long to begin."""


def run_on(data: Sequence[Array], lag: int) -> list[Array]:
    """Inputs, outputs and masks with `lag` more samples at the end at which nothing was measured.

    After them the outputs have reached the last sample of the recording. The inputs stay.
    """
    if not lag:
        return list(data)
    u, y, mask = data
    return [
        np.vstack([u, np.repeat(u[-1:], lag, axis=0)]),
        *(np.vstack([a, np.zeros((lag, a.shape[1]))]) for a in (y, mask)),
    ]


def from_first_sample(outputs: Sequence[Array], lag: int) -> list[Array]:
    """Outputs without those that are about samples before the first."""
    return [output[lag:] for output in outputs]


@dataclasses.dataclass(frozen=True)
class Block:
    """Results of successive samples, as of `named`; the first of them is sample `start`."""

    start: int
    stop: int
    values: Mapping[str, Array]


def carried(
    recursion: Recursion,
    data: Sequence[Array],
    *,
    engine: str,
    progress: Callable[[int], None] = lambda _: None,
) -> Iterator[Block]:
    """Apply a recursion to a recording, block by block."""
    rows, lag = run_on(data, recursion.lag), recursion.lag
    n, size = len(rows[0]), VM_BLOCK if engine == "vm" else BLOCK
    carry, at_once = recursion.carry0, None
    for start in range(0, n, size):
        part = [a[start : start + size] for a in rows]
        began = time.perf_counter()
        carry, outputs = run_part(recursion, carry, part, engine=engine, block=at_once)
        if engine == "native":
            at_once = size if time.perf_counter() - began < QUICK else None
        stop, early = start + len(part[0]), max(lag - start, 0)
        progress(min(stop, n - lag))
        if stop > lag:
            found = [output[early:] for output in outputs]
            yield Block(start + early - lag, stop - lag, named(found, recursion.channels))


class Store:
    """Results in memory, of the samples that are kept.

    Parameters
    ----------
    outputs : Outputs
    channels : sequence of Channel
        What there is.
    samples : int
        Of the recording.
    """

    def __init__(self, outputs: Outputs, channels: Sequence[Channel], samples: int) -> None:
        self._outputs, self._count = outputs, -(-samples // outputs.every)
        self._names = [c.name for c in channels if outputs.keeps(c.name)]
        self.values: dict[str, np.ndarray] = {}

    def add(self, block: Block) -> None:
        """Take in the results of a block; blocks come in their order."""
        every = self._outputs.every
        before, first = -block.start % every, -(-block.start // every)
        for name in self._names:
            values = block.values[name]
            if name not in self.values:
                kind = np.int32 if name == "status" else self._outputs.dtype
                self.values[name] = np.empty((self._count, *values.shape[1:]), kind)
            kept = values[before::every]
            self.values[name][first : first + len(kept)] = kept
        if every > 1:
            self._gather_status(block.values["status"], before, first)

    def _gather_status(self, status: Array, before: int, first: int) -> None:
        """Add what happened at samples that are not kept to the sample that is kept before them."""
        told = self.values["status"]
        if before:
            told[first - 1] |= np.bitwise_or.reduce(status[:before])
        starts = np.arange(before, len(status), self._outputs.every)
        if len(starts):
            told[first : first + len(starts)] = np.bitwise_or.reduceat(status, starts)
