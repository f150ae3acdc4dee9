"""Everything that says whether a result agrees with itself, in one value."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.analysis.consistency._coverage import (
    MeanNees,
    coverage,
    innovation_coverage,
    mean_nees,
)
from backsight.analysis.consistency._nis import mean_nis, measured_channels, nis, nis_band
from backsight.analysis.consistency._noise_factors import LIKELY, SURE, NoiseFactors
from backsight.analysis.consistency.whiteness import Colour, colours
from backsight.description import Printed, checked
from backsight.errors import DataError
from backsight.rounding import significant
from backsight.schema import INNOVATIONS, Innovations, check_estimates

LEVEL = 0.01
"""A sound result is doubted so often at most."""

SHARE = LEVEL / 4
"""Level of each of the questions: size, whiteness, inputs, and the noise factors."""

WEAK = 0.1
"""Correlations below this do no harm in practice, however certain they are."""

LITTLE = 0.02
"""Share of the innovations that inputs may explain without harm."""

APART = 1.05
"""So many times more what is new in the inputs must explain than all of their past, to be noise."""

NOISE_FACTORS = "noise_factors"
"""Attribute of a result with the values of `NoiseFactors`, in their order."""


@dataclasses.dataclass(frozen=True)
class Consistency(Printed):
    """Agreement of a result with its own covariances; prints itself.

    Parameters
    ----------
    mean_nis, nis_expected : float
        Mean normalised innovation squared and its expectation.
    nis_band : (float, float)
        Where the mean of a consistent estimator lies with probability 1 - `SHARE`.
    colours : tuple of Colour
        What is left in the innovations of every output.
    innovations : dict
        Output to the shares of its innovations within 1, 2 and 3 deviations.
    nees : MeanNees
        Of the states whose truth is known.
    states : dict
        State whose truth is known to the shares within 1, 2 and 3 deviations.
    noise : NoiseFactors or None
        By how much R and Q are wrong, where the result says so (see
        `backsight.run.diagnosis._factors_of_results`).
    kind : {"white", "coloured", "forced"}
        What the innovations of the estimator are by nature, see `schema.Innovations`. Only white
        ones are doubted for their colour, and those with unknown forces for their size alone.
    """

    mean_nis: float
    nis_expected: float
    nis_band: tuple[float, float]
    colours: tuple[Colour, ...]
    innovations: dict[str, tuple[float, float, float]]
    nees: MeanNees
    states: dict[str, tuple[float, float, float]]
    noise: NoiseFactors | None
    kind: Innovations = "white"

    @property
    def sized(self) -> bool:
        """Whether the innovations are as large as predicted."""
        return self.nis_band[0] <= self.mean_nis <= self.nis_band[1]

    @property
    def coloured(self) -> Colour | None:
        """The output whose innovations are least white, if they should be and it matters."""
        level = SHARE / max(len(self.colours), 1) if self.kind == "white" else 0.0
        doubted = [c for c in self.colours if c.p_white < level and abs(c.largest) >= WEAK]
        return max(doubted, key=lambda c: abs(c.largest), default=None)

    @property
    def driven(self) -> Colour | None:
        """The output whose innovations past inputs explain best, if they do and it matters."""
        level = SHARE / max(len(self.colours), 1) if self.kind != "forced" else 0.0
        doubted = [c for c in self.colours if c.p_input < level and c.explained > LITTLE]
        return max(doubted, key=lambda c: c.explained, default=None)

    @property
    def noisy(self) -> Colour | None:
        """The output whose innovations follow noise in an input, if any do and it matters.

        What is new in the input must explain more than its whole past does. It is no doubt by
        itself: process noise may well have been made as large as it takes.
        """
        level = SHARE / max(len(self.colours), 1) if self.kind != "forced" else 0.0
        found = [
            c
            for c in self.colours
            if c.p_noise < level and c.noise > max(LITTLE, APART * _or_zero(c.explained))
        ]
        return max(found, key=lambda c: c.noise, default=None)

    @property
    def misjudged(self) -> bool:
        """Whether R or Q is wrong for certain, and by so much that it matters."""
        noise = self.noise
        if noise is None:
            return False
        deviations = LIKELY if noise.doubted else SURE
        return noise.R_wrong(deviations) or noise.Q_wrong(deviations)

    @property
    def consistent(self) -> bool:
        """Whether nothing speaks against the result; the verdict says the same in words."""
        doubts = self.coloured is not None or self.driven is not None or self.misjudged
        return self.sized and not doubts

    def __str__(self) -> str:
        low, high = self.nis_band
        lines = [
            f"mean NIS {significant(self.mean_nis, 4)}, expected {significant(self.nis_expected)} "
            f"({significant(low, 4)} to {significant(high, 4)} with {1 - SHARE:.2%})"
        ]
        if not math.isnan(self.nees.value):
            low, high = self.nees.band
            lines.append(
                f"mean NEES {significant(self.nees.value, 4)}, expected "
                f"{significant(self.nees.expected)} "
                f"({significant(low, 4)} to {significant(high, 4)} with 95%)"
            )
        lines += [_described(c, self.kind) for c in self.colours]
        for kind, shares in (("innovations", self.innovations), ("errors", self.states)):
            for name, inside in shares.items():
                share = " / ".join(f"{100 * s:.1f}" for s in inside)
                lines.append(f"{name}: {share} % of the {kind} within 1 / 2 / 3 σ")
        if self.noise is not None:
            lines.append(
                f"R should be {significant(self.noise.R)} ± {significant(self.noise.R_std, 2)} "
                f"times, Q {significant(self.noise.Q)} ± {significant(self.noise.Q_std, 2)} times "
                "what was assumed"
            )
        return "\n".join(lines)


@checked(DataError)
def check_consistency(result: xr.Dataset) -> Consistency:
    """Judge how a result agrees with its own covariances; see `Consistency`.

    Parameters
    ----------
    result : xarray.Dataset
        A result; with ``x_true``, the errors are judged, too.

    Raises
    ------
    DataError
        If the dataset is not a result, or has no sample.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> found = bs.check.check_consistency(bs.estimate(kf, spring, recording, engine="vm"))
    >>> found.nis_band[0] < found.mean_nis < found.nis_band[1]
    True
    """
    check_estimates(result, "the dataset")
    if result.sizes["time"] == 0:
        raise DataError("the result has no sample")
    valid = np.isfinite(nis(result))
    factors = result.attrs.get(NOISE_FACTORS)
    return Consistency(
        mean_nis=mean_nis(result),
        nis_expected=float(measured_channels(result).where(valid).mean("time")),
        nis_band=nis_band(result, 1.0 - SHARE),
        colours=colours(result),
        innovations=_by_name(innovation_coverage(result), "output"),
        nees=mean_nees(result),
        states=_by_name(coverage(result), "state"),
        noise=None if factors is None else _of_attribute(factors),
        kind=result.attrs.get(INNOVATIONS, "white"),
    )


def _of_attribute(factors: Sequence[float]) -> NoiseFactors:
    numbers = [float(v) for v in factors]
    return NoiseFactors(*numbers[:7], doubted=any(numbers[7:]))


def _or_zero(share: float) -> float:
    return 0.0 if math.isnan(share) else share


def _by_name(shares: xr.DataArray, dim: str) -> dict[str, tuple[float, float, float]]:
    columns = {str(n): shares.sel({dim: n}).values for n in shares[dim].values}
    known = {n: v for n, v in columns.items() if np.isfinite(v).all()}
    return {n: (float(v[0]), float(v[1]), float(v[2])) for n, v in known.items()}


def _described(c: Colour, kind: Innovations) -> str:
    reason = {
        "white": f"chance {significant(c.p_white, 2)}",
        "coloured": "its gain makes some",
        "forced": "unknown forces make some",
    }[kind]
    text = (
        f"{c.output}: correlation of successive innovations {significant(c.lag1, 2)}, largest "
        f"{significant(c.largest, 2)} at {c.lag} samples ({reason})"
    )
    if not c.input:
        return text
    return (
        f"{text}; past inputs explain {100 * c.explained:.2g} % (chance "
        f"{significant(c.p_input, 2)}), most of it '{c.input}' {c.delay} samples earlier"
    )
