"""What of a result is kept; the rest is neither stored nor, as far as that is cheap, computed."""

import dataclasses
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Literal, TypeAlias

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import side
from backsight.description import Count, Description, Distinct, Sound
from backsight.engine.dense import UNROLL
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError, nearest

ALWAYS = ("x_hat", "status")
"""Variables without which nobody could tell what a result is worth."""

RECORDED = ("u", "y", "sigma_factor", "x_true")
"""Variables that come from the recording."""

DEVIATIONS = {"x_std": "P", "d_std": "P_d", "e_std": "S"}
"""Standard deviations, and the covariances whose diagonals they are the roots of."""

JUDGED = ("x_hat", "x_std", "y_hat", "e", "e_std", "status")
"""What is looked at in every sample to tell whether the estimator has diverged."""


@dataclasses.dataclass(frozen=True)
class Outputs(Description):
    """What of a result is kept.

    Parameters
    ----------
    variables : sequence of str, optional
        Names of variables of the result, such as ``x_std``, ``e`` or ``y``, and ``e_std``, the
        standard deviations of the innovations; `x_hat` and `status` are always kept. With ``x_std``
        come the ends of the bands of states that are positive. All but ``e_std`` if not given.
    every : int
        Keep every so many samples, from the first one on. The status of a sample that is kept tells
        what happened since the one before; that of the last one, to the end.
    dtype : {"float64", "float32"}
        How numbers are stored; they are computed as ``float64`` in any case.

    Notes
    -----
    The verdict, `backsight.check.check_consistency` and the report need all variables but ``P``.

    Examples
    --------
    >>> bs.large.Outputs(("x_std",), every=10).every
    10
    """

    variables: Annotated[tuple[str, ...], Distinct()] | None = None
    every: Count = 1
    dtype: Literal["float64", "float32"] = "float64"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("variables") and self.variables == ():
            yield f"variables is empty; name at least one, such as {', '.join(ALWAYS)}"

    def keeps(self, variable: str) -> bool:
        """Whether a variable is part of the result."""
        if self.variables is None:
            return variable != "e_std"
        return variable in ALWAYS or variable in self.variables


Kept: TypeAlias = Outputs | Sequence[str]
"""What of a result is kept, or just the names of variables."""


ALL = Outputs()
"""Everything that an estimator puts out."""


def as_outputs(given: Kept | None) -> Outputs:
    """What a caller means; everything if nothing is given."""
    if given is None:
        return ALL
    return given if isinstance(given, Outputs) else Outputs(tuple(given))


def putting_out(
    recursion: Recursion, outputs: Outputs, needed: Collection[str] = JUDGED
) -> Recursion:
    """A recursion that puts out what is kept, as it stands in a result, and what is `needed`.

    Symmetric matrices of few rows are whole, so that nobody has to unfold them afterwards.

    Raises
    ------
    TuningError
        If there is no variable of such a name.
    """
    channels = {c.name: c for c in recursion.channels}
    from_others = {k: v for k, v in DEVIATIONS.items() if k not in channels and v in channels}
    there = [*channels, *from_others, *RECORDED]
    for name in outputs.variables or ():
        if name not in there:
            raise TuningError(f"outputs: there is no variable '{name}', {nearest(name, there)}")
    wanted = [n for n in [*channels, *from_others] if outputs.keeps(n) or n in needed]
    symbols = [ca.MX.sym(f"i{k}", recursion.step.numel_in(k)) for k in range(recursion.step.n_in())]
    after, *every = recursion.step.call(symbols, True, False)
    values = dict(zip(channels, every, strict=True))
    made = [
        _deviation(channels[from_others[n]], values[from_others[n]])
        if n in from_others
        else _whole(channels[n], values[n])
        for n in wanted
    ]
    renamed = [
        dataclasses.replace(channel, name=name)
        for name, (channel, _) in zip(wanted, made, strict=True)
    ]
    step = ca.Function(recursion.name, symbols, [after, *(value for _, value in made)])
    return dataclasses.replace(recursion, step=step, channels=tuple(renamed))


def _whole(channel: Channel, value: ca.MX) -> tuple[Channel, ca.MX]:
    """A symmetric matrix with all its entries, if that are not too many."""
    if not channel.symmetric or side(value.numel()) > UNROLL:
        return channel, value
    entries = channel.entries(value.numel()).ravel()
    return dataclasses.replace(channel, symmetric=False), value[entries.tolist()]


def _deviation(channel: Channel, value: ca.MX) -> tuple[Channel, ca.MX]:
    """Standard deviations of what has this covariance."""
    diagonal = np.diag(channel.entries(value.numel()))
    variance = ca.SX.sym("variance", len(diagonal))
    # Not fmax, which makes 0 of NaN.
    inside = ca.if_else(variance < 0, 0, variance)
    root = ca.Function(f"deviation_{len(diagonal)}", [variance], [ca.sqrt(inside)])
    plain = dataclasses.replace(channel, dims=channel.dims[:1], symmetric=False)
    return plain, root(value[diagonal.tolist()])
