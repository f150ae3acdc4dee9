"""All forces of all windows, not only the output of each."""

import dataclasses

import casadi as ca
import numpy as np
import xarray as xr

from backsight.engine import native
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.cs_mhe import CompressiveSensingMHE
from backsight.models.model import Model
from backsight.run.estimation import match, run_on
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Windows:
    """What the full windows of a recording found.

    Parameters
    ----------
    alpha : (windows, steps, forces) array
        Forces [N]; window i begins at sample i.
    kkt : (windows,) array
        Violation of the optimality conditions as a share of lam.
    lam_max : (windows,) array
        Weight from which on the window would find nothing.
    x, x_std : (windows, states) arrays
        States at the first sample of each window and their standard deviations.
    """

    alpha: Array
    kkt: Array
    lam_max: Array
    x: Array
    x_std: Array

    @property
    def output(self) -> Array:
        """Forces at the first step of each window (windows, forces), as found."""
        return self.alpha[:, 0]


@dataclasses.dataclass(frozen=True)
class Program:
    """An estimator compiled for a model, to be run over many recordings.

    Parameters
    ----------
    estimator : CompressiveSensingMHE
        With impulses as dictionary and output at the first sample of the window.
    model : Model
        Without known inputs.
    recursion : Recursion
        Puts its memory out as well.
    """

    estimator: CompressiveSensingMHE
    model: Model
    recursion: Recursion

    def run(self, recording: xr.Dataset) -> Windows:
        """Solve all full windows of a recording."""
        return self._run(recording, 1.0)

    def run_with(self, recording: xr.Dataset, lam: float) -> Windows:
        r"""Solve all full windows with another weight of the l1 norm.

        Cost and model are homogeneous: if :math:`(\alpha, y)` belong to :math:`\lambda`, then
        :math:`(s \alpha, s y)` belong to :math:`s \lambda`. So one program serves for all
        weights; forces above the threshold are those above it after the scaling.

        Raises
        ------
        TuningError
            If there is a carryover, which knows forces by their size.
        """
        if self.estimator.carryover:
            raise TuningError("an estimator with a carryover has no weight but its own")
        return self._run(recording, self.estimator.lam / lam)

    def _run(self, recording: xr.Dataset, scale: float) -> Windows:
        N, (u, y, mask) = self.estimator.N, match(self.model, recording)
        data = run_on([u, scale * y, mask], N)
        _, outputs = native.run(self.recursion, data, carry=self.recursion.carry0)
        *columns, memory = (values[N : len(y)] for values in outputs)
        named = {c.name: v for c, v in zip(self.recursion.channels, columns, strict=True)}
        P = self.recursion.channels[1].unpack(named["P"])
        later = _later(self.estimator, memory, ny=y.shape[1])
        alpha = np.concatenate([named["d_raw"][:, np.newaxis], later], axis=1) / scale
        return Windows(
            alpha=alpha,
            kkt=named["kkt"][:, 0],
            lam_max=named["lam_max"][:, 0] / scale,
            x=named["x_hat"] / scale,
            x_std=np.sqrt(np.einsum("kii->ki", P)),
        )


def program(estimator: CompressiveSensingMHE, model: Model, dt: float) -> Program:
    """Compile an estimator that shows all of its window."""
    return Program(estimator, model, told(estimator.compile(model, dt)))


def told(recursion: Recursion) -> Recursion:
    """Put the memory of a recursion out as well, after its other outputs."""
    symbols = [ca.MX.sym(f"i{i}", recursion.step.numel_in(i)) for i in range(recursion.step.n_in())]
    carry, *outputs = recursion.step.call(symbols)
    step = ca.Function(f"{recursion.name}_told", symbols, [carry, *outputs, carry])
    return dataclasses.replace(recursion, step=step)


def _later(estimator: CompressiveSensingMHE, memory: Array, *, ny: int) -> Array:
    """Forces after the first step of the window, which the next window starts from.

    The memory ends with them, one step earlier and with an empty last step; with what the next
    window expects and the variances of that, if there is a carryover; and with the innovations,
    and the lower triangles of their covariances, of the samples of the lag. What is expected may be
    left out of the first of these.
    """
    forces, steps = len(estimator.forces), estimator.N
    late, size = estimator.delay * (ny + ny * (ny + 1) // 2), forces * steps
    count = 3 if estimator.carryover else 1
    end = memory.shape[1] - late
    parts = memory[:, end - count * size : end].reshape(len(memory), count, steps, forces)
    found = parts[:, 0]
    if estimator.carryover:
        found = np.where(found != 0, found, parts[:, 1])
    return found[:, :-1]
