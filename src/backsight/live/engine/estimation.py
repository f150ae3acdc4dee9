"""Carry a recursion over samples as they come, and go back for those that come late.

What is kept is the rows that may still change and, at some of them, the memory of the estimator. A
late sample is put into its row; the memory kept before that row is taken and run forward again, so
that the result is that of the samples in order, to the last bit.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from backsight.engine.execute import prepare, run_part
from backsight.engine.recursion import Recursion
from backsight.live.clock.rows import RowBuffer
from backsight.live.engine.checkpoint import Checkpoint, filled_forward
from backsight.models.model import Model
from backsight.run.estimation import Measured, looked_at, named, run_on, sensed_outputs
from backsight.types import Array

_PIECES = 16
"""Memories that are kept along the lag: going back costs up to a sixteenth of it more."""

_SHORTEST, _LONGEST = 32, 4096
"""Samples between two kept memories."""


@dataclasses.dataclass(frozen=True)
class LiveRows:
    """Successive samples with what was estimated of them.

    Parameters
    ----------
    start : int
        Slot of the first one.
    u, y : (n, nu) and (n, ny) arrays
        Inputs as they were held, and what was measured; NaN where nothing was.
    values : dict
        Variables of a result.
    """

    start: int
    u: Array
    y: Array
    values: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.u)


class LiveEstimation:
    """An estimator at work on rows that may still change.

    Parameters
    ----------
    recursion : Recursion
    model : Model
    lag : int
        Samples that may still change after they were estimated.
    engine : str
    memory : Checkpoint, optional
        Where to go on.
    """

    def __init__(
        self,
        recursion: Recursion,
        model: Model,
        *,
        lag: int,
        engine: str = "native",
        memory: Checkpoint | None = None,
    ) -> None:
        self.recursion, self.model, self.engine = recursion, model, engine
        self.lag = lag
        self._spacing = int(np.clip(lag // _PIECES, _SHORTEST, _LONGEST))
        prepare(recursion, engine)
        self._dummy = np.array([np.nan if s.dummy is None else s.dummy for s in model.outputs])
        self._largest = np.zeros(model.ny)
        begin = memory or Checkpoint.fresh(recursion, model)
        self._go_on(begin)

    def _go_on(self, memory: Checkpoint) -> None:
        base = memory.slot - len(memory.waiting)
        self.measured = RowBuffer(self.model.nu + self.model.ny, base)
        self.inputs = RowBuffer(self.model.nu, base)
        self.estimated = RowBuffer(sum(self.recursion.output_sizes), memory.slot)
        rows = np.vstack([memory.waiting, memory.coming])
        self.measured.extend(base + len(rows))
        self.measured.view(base, base + len(rows))[:] = rows
        self.inputs.extend(memory.slot)
        self.inputs.view(base, memory.slot)[:] = memory.waiting_inputs
        self._before, self.begun = memory.before, memory.begun
        self._largest = memory.largest
        self.done, self._carry = memory.slot, memory.carry.copy()
        self._kept: list[tuple[int, Array]] = [(self.done, self._carry.copy())]
        self._dirty = self.done
        self._estimates_from = memory.first_estimate

    @property
    def base(self) -> int:
        """First slot that may still change."""
        return self._kept[0][0]

    def put(
        self, columns: Sequence[int], slots: np.ndarray, values: Array
    ) -> tuple[int, np.ndarray]:
        """Put values (n, m) into columns of the rows at slots (n,), see `RowBuffer.put`."""
        if not len(slots):
            return 0, np.zeros(0, bool)
        duplicates, changed = self.measured.put(columns, slots, values)
        past = changed & (slots < self.done)
        if past.any():
            self._dirty = min(self._dirty, int(slots[past].min()))
        return duplicates, changed

    def advance(self, stop: int, *, at_once: bool = False) -> None:
        """Estimate the rows up to a slot, and again those from which a late sample changed on.

        The first of all samples waits for earlier ones over the lag, unless it is needed `at_once`.
        """
        stop = max(stop, self.done)
        self.measured.extend(stop)
        if not self.begun and not self._begin(stop, at_once=at_once):
            return
        if self._dirty < self.done:
            self._go_back(self._dirty)
        while self.done < stop:
            if self.lag and self.done - self._kept[-1][0] >= self._spacing:
                self._kept.append((self.done, self._carry.copy()))
            step = self._spacing if self.lag else _LONGEST
            self._run(self.done, min(stop, self.done + step))
        self._dirty = self.done

    def _begin(self, stop: int, *, at_once: bool) -> bool:
        """Pass over the rows before all inputs are known; whether the first row is found.

        Without inputs, it is the first one in which anything was measured.
        """
        nu, base = self.model.nu, self.measured.base
        rows = self.measured.view(base, stop)
        known = filled_forward(rows[:, :nu], self._before)
        begun = np.logical_or.accumulate(np.isfinite(rows).any(axis=1))
        ready = np.flatnonzero(np.isfinite(known).all(axis=1) & begun)
        first = base + int(ready[0]) if len(ready) else max(stop - self.lag, base)
        if len(ready) and first > base and stop - first <= self.lag and not at_once:
            return False
        if first > base:
            self._before = known[first - base - 1]
        for buffer in (self.measured, self.inputs, self.estimated):
            buffer.drop(first)
        self.done = self._dirty = self._estimates_from = first
        self._kept = [(first, self._carry.copy())]
        self.begun = bool(len(ready))
        return self.begun

    def _go_back(self, slot: int) -> None:
        """Take the newest memory that was kept before a slot."""
        while len(self._kept) > 1 and self._kept[-1][0] > slot:
            self._kept.pop()
        self.done, carry = self._kept[-1]
        self._carry = carry.copy()

    def _run(self, start: int, stop: int) -> None:
        nu = self.model.nu
        rows = self.measured.view(start, stop)
        self.inputs.extend(stop)
        before = self.inputs.view(start - 1, start)[0] if start > self.inputs.base else self._before
        u = filled_forward(rows[:, :nu], before)
        self.inputs.view(start, stop)[:] = u
        y = np.where(np.isnan(self._dummy), rows[:, nu:], self._dummy)
        known = np.isfinite(y)
        data = [u, np.where(known, y, 0.0), known.astype(float)]
        self._carry, outputs = run_part(
            self.recursion, self._carry, data, engine=self.engine, block=stop - start
        )
        self.estimated.extend(stop)
        self.estimated.view(start, stop)[:] = np.hstack(outputs)
        self.done = stop

    def newest(self, start: int) -> LiveRows:
        """What is known now of the samples from a slot on; they may still change."""
        first = max(start, self._estimates_from, self.inputs.base)
        return self._rows(first, max(self.done - self.recursion.lag, first))

    def settle(self, *, all_of_it: bool = False) -> LiveRows:
        """Take the samples that no longer change, and forget them.

        Parameters
        ----------
        all_of_it : bool
            What comes after is another beginning: nothing changes any more.
        """
        if all_of_it:
            return self._close()
        limit = self.done - self.lag
        if not self.lag:
            self._kept = [(self.done, self._carry.copy())]
        while len(self._kept) > 1 and self._kept[1][0] <= limit:
            self._kept.pop(0)
        return self._take(self._kept[0][0] - self.recursion.lag)

    def finish(self) -> LiveRows:
        """Take all samples that were estimated, as if they could not change any more."""
        self._kept = [(self.done, self._carry.copy())]
        return self._take(self.done - self.recursion.lag)

    def _take(self, stop: int) -> LiveRows:
        stop = max(stop, self._estimates_from)
        rows = self._rows(self._estimates_from, stop)
        if len(rows):
            self._before = rows.u[-1]
        self._estimates_from = stop
        self.measured.drop(max(stop, self.measured.base))
        self.inputs.drop(max(stop, self.inputs.base))
        unsettled = min(stop + self.recursion.lag, self._kept[0][0])
        self.estimated.drop(max(unsettled, self.estimated.base))
        return rows

    def _close(self) -> LiveRows:
        """Run on until the estimates have reached the last sample."""
        lag, stop = self.recursion.lag, self.done
        if lag and self.begun and stop > self.inputs.base:
            nothing = [np.empty((0, self.model.ny))] * 2
            u, y, mask = run_on([self.inputs.view(stop - 1, stop), *nothing], lag)
            data = [u[1:], y, mask]
            _, outputs = run_part(self.recursion, self._carry, data, engine=self.engine, block=lag)
            self.estimated.extend(stop + lag)
            self.estimated.view(stop, stop + lag)[:] = np.hstack(outputs)
        return self._take(stop)

    def begin_anew(self, slot: int) -> None:
        """Forget everything but the inputs: the next sample is that of another slot."""
        fresh = Checkpoint.fresh(self.recursion, self.model)
        self._go_on(
            dataclasses.replace(
                fresh,
                slot=slot,
                first_estimate=slot,
                before=self._before,
                begun=self.begun,
                largest=self._largest,
            )
        )

    def _rows(self, start: int, stop: int) -> LiveRows:
        lag = self.recursion.lag
        raw = self.measured.view(start, stop)[:, self.model.nu :]
        y = sensed_outputs(self.model, raw, np.isfinite(raw))
        if len(y):
            self._largest = np.fmax(self._largest, np.nanmax(np.abs(y), axis=0, initial=0.0))
        flat = self.estimated.view(start + lag, stop + lag)
        cuts = np.cumsum(self.recursion.output_sizes)[:-1]
        values = named(np.split(flat, cuts, axis=1), self.recursion.channels)
        seen = looked_at(values, Measured(y, self._largest), self.model)
        u = self.inputs.view(start, stop).copy()
        return LiveRows(start, u, y.copy(), {n: np.array(v) for n, v in seen.items()})

    def checkpoint(self) -> Checkpoint:
        """All that must be kept to go on after the samples that are settled."""
        slot, carry = self._kept[0]
        nu, first = self.model.nu, self._estimates_from
        return Checkpoint(
            slot=slot,
            carry=carry.copy(),
            waiting=self.measured.view(min(first, slot), slot).copy(),
            waiting_inputs=self.inputs.view(min(first, slot), slot).copy(),
            coming=self.measured.view(slot, self.measured.stop).copy(),
            before=self._before.copy() if nu else np.empty(0),
            begun=self.begun,
            largest=self._largest.copy(),
            first_estimate=first,
        )
