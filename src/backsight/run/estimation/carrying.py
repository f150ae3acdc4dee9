"""Carry a recursion over the samples of a recording, and put results to what they are about."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from backsight.engine.execute import run_part
from backsight.engine.recursion import Recursion
from backsight.run.estimation.results.outputs import Outputs
from backsight.run.estimation.results.values import named
from backsight.types import Array

BLOCK = 16_384
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
    into: Sequence[Array] = (),
) -> Iterator[Block]:
    """Apply a recursion to a recording, block by block; with `into` to `Store.places`."""
    rows, lag = run_on(data, recursion.lag), recursion.lag
    n, size = len(rows[0]), VM_BLOCK if engine == "vm" else BLOCK
    carry, at_once = recursion.carry0, None
    for start in range(0, n, size):
        part = [a[start : start + size] for a in rows]
        began = time.perf_counter()
        places = [a[start : start + size] for a in into]
        carry, outputs = run_part(recursion, carry, part, engine=engine, block=at_once, into=places)
        if engine == "native":
            at_once = size if time.perf_counter() - began < QUICK else None
        stop, early = start + len(part[0]), max(lag - start, 0)
        progress(min(stop, n - lag))
        if stop > lag:
            found = [output[early:] for output in outputs]
            yield Block(start + early - lag, stop - lag, named(found, recursion.channels))


class Thinning:
    """Take every so many samples of successive blocks, with what happened between them.

    Parameters
    ----------
    outputs : Outputs
    missed : int
        Status bits of samples since the last one that was taken.
    """

    def __init__(self, outputs: Outputs, missed: int = 0) -> None:
        self._outputs, self.missed = outputs, missed

    def taken(self, block: Block) -> tuple[int, dict[str, np.ndarray]]:
        """Number of the first sample that is taken, by those that are; and what is kept of them.

        The status tells of all samples since the one that was taken before.
        """
        every, status = self._outputs.every, block.values["status"]
        before, first = -block.start % every, -(-block.start // every)
        kept = {
            name: _stored(values[before::every], self._outputs.dtype)
            for name, values in block.values.items()
            if self._outputs.keeps(name)
        }
        if every > 1:
            kept["status"] = self._gathered(status, before)
        return first, kept

    def _gathered(self, status: np.ndarray, before: int) -> np.ndarray:
        every = self._outputs.every
        count = len(range(before, len(status), every))
        starts = np.concatenate([[0], before + 1 + every * np.arange(count)])
        inside = starts[starts < len(status)]
        # Up to every sample that is taken, and what comes after the last one.
        told = np.zeros(count + 1, np.int32)
        told[: len(inside)] = np.bitwise_or.reduceat(status, inside)
        told[0] |= self.missed
        self.missed = int(told[count])
        return told[:count]


def _stored(values: np.ndarray, dtype: str) -> np.ndarray:
    return values.astype(values.dtype if values.dtype == np.int32 else dtype, copy=False)


class Store:
    """Results in memory, of the samples that are kept.

    Parameters
    ----------
    outputs : Outputs
    samples : int
        Of the recording.
    """

    def __init__(self, outputs: Outputs, samples: int) -> None:
        self._samples, self._count = samples, -(-samples // outputs.every)
        self._outputs, self._thinning = outputs, Thinning(outputs)
        self.values: dict[str, np.ndarray] = {}

    def places(self, recursion: Recursion, engine: str) -> list[Array]:
        """Where the engine can put the outputs of all samples, so that nobody copies them.

        None where they are stored in another form.
        """
        plain = self._outputs.every == 1 and self._outputs.dtype == "float64"
        if engine != "native" or recursion.lag or not plain:
            return []
        whole = [np.empty((self._samples, size)) for size in recursion.output_sizes]
        for channel, place in zip(recursion.channels, whole, strict=True):
            other = channel.symmetric or channel.name == "status"
            if self._outputs.keeps(channel.name) and not other:
                self.values[channel.name] = channel.unpack(place)
        return whole

    def add(self, block: Block) -> None:
        """Take in the results of a block; blocks come in their order."""
        first, kept = self._thinning.taken(block)
        if not self.values and first == 0 and block.stop == self._samples == self._count:
            self.values = kept  # all at once: a copy would take as long as the samples
            return
        for name, values in kept.items():
            if name not in self.values:
                self.values[name] = np.empty((self._count, *values.shape[1:]), values.dtype)
            place = self.values[name][first : first + len(values)]
            if not np.may_share_memory(place, values):  # not yet in its place
                place[...] = values
        if block.stop == self._samples:  # what came after the last sample that is kept
            self.values["status"][-1] |= self._thinning.missed
