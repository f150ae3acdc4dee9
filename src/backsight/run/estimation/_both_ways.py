"""The pass forward and the pass back of a smoother, over as many samples as there may be."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from backsight.engine.execute import run_part
from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.models.model import Model
from backsight.run.estimation._match import dummies
from backsight.run.estimation.carrying import VM_BLOCK, Block
from backsight.types import Array

LEAST_BLOCK = 1000
"""Samples of a block at least."""

CACHED = 2**19
"""Numbers that a block may take: what goes forward is still in the processor's cache on the way
back."""

KEPT = 2**24
"""Numbers that all of a recording may take to go forward once only."""

Samples = Callable[[slice], tuple[Array, Array, Array]]
"""Inputs, outputs and mask of some samples."""


def samples_of(model: Model, data: tuple[Array, Array, Array], measured: Array) -> Samples:
    """Samples of data as of `match`, of which `measured` (n, ny) has NaN where nothing was.

    That tells all of them unless samples have a noise of their own or outputs are dummies: of a
    long recording there are then no copies.
    """
    u, y, mask = data
    if dummies(model).any() or ((mask != 0) & (mask != 1)).any():
        return lambda part: (u[part], y[part], mask[part])

    def read(part: slice) -> tuple[Array, Array, Array]:
        seen = np.isfinite(measured[part])
        return u[part], np.where(seen, measured[part], 0.0), seen.astype(float)

    return read


def blocks_back(
    passes: ForwardBackward,
    data: Samples,
    carries: tuple[Array, Array],
    u_after: Array,
    *,
    samples: int,
    engine: str,
    progress: Callable[[int], None],
) -> Iterator[tuple[Block, Array]]:
    """Smoothed samples from the last block to the first; and the memory of the pass back."""
    n, forward, backward = samples, passes.forward, passes.backward
    size = _block_size(forward, n, engine)
    at_once = n if n * sum(forward.output_sizes) <= KEPT else size
    chunks = list(cut(slice(0, n), at_once))
    starts, carry = [carries[0]], carries[1]
    for chunk in chunks[:-1]:
        starts.append(run_part(forward, starts[-1], data(chunk), engine=engine)[0])
        progress(chunk.stop // 2)
    for chunk, start in zip(reversed(chunks), reversed(starts), strict=True):
        _, outputs = run_part(forward, start, data(chunk), engine=engine)
        for part in reversed(list(cut(chunk, size))):
            inside = slice(part.start - chunk.start, part.stop - chunk.start)
            found = [output[inside] for output in outputs]
            u, y, mask = data(part)
            after = np.vstack([u[1:], u_after[None]])
            if passes.weights is not None:
                mask = mask * found[passes.weights]
            rows = [*found[: passes.handed], u, after, y, mask]
            carry, smoothed = run_part(backward, carry, [a[::-1] for a in rows], engine=engine)
            u_after = u[0]
            yield Block(part.start, part.stop, _joined(passes, found, smoothed)), carry
            progress(n - part.start // 2 - part.start % 2)


def _block_size(forward: Recursion, n: int, engine: str) -> int:
    """Samples of a block; blocks, of each of which a memory is kept, are not many either."""
    if engine == "vm":
        return VM_BLOCK
    return max(LEAST_BLOCK, math.isqrt(n), CACHED // sum(forward.output_sizes))


def cut(whole: slice, size: int) -> Iterator[slice]:
    for start in range(whole.start, whole.stop, size):
        yield slice(start, min(start + size, whole.stop))


def _joined(
    passes: ForwardBackward, outputs: Sequence[Array], smoothed: Sequence[Array]
) -> dict[str, Array]:
    """Results of both passes by name; those of the pass back came from the last sample on."""
    backward = passes.backward.channels
    found = {c.name: v[::-1] for c, v in zip(backward, smoothed, strict=True)}
    own = passes.forward.channels[passes.handed :]
    for channel, value in zip(own, outputs[passes.handed :], strict=True):
        known = found.get(channel.name)
        found[channel.name] = value if known is None else _either(value, known)
    return found


def _either(a: Array, b: Array) -> Array:
    """Status bits that are raised in one pass or the other; NaN is not a status."""
    bits = (np.nan_to_num(k).astype(np.int64) for k in (a, b))
    return np.bitwise_or(*bits).astype(float)


def results_of(passes: ForwardBackward) -> dict[str, Channel]:
    """Results by name: those of the pass back, then those of the pass forward."""
    both = (*passes.backward.channels, *passes.forward.channels[passes.handed :])
    return {channel.name: channel for channel in both}


def lengths_of(passes: ForwardBackward) -> dict[str, int]:
    """How many numbers of a result there are at a sample."""
    back = zip(passes.backward.channels, passes.backward.output_sizes, strict=True)
    forward = zip(passes.forward.channels, passes.forward.output_sizes, strict=True)
    own = list(forward)[passes.handed :]
    return {channel.name: size for channel, size in (*back, *own)}
