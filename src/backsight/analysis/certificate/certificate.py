"""Whether an estimator equals the Kalman filter and least squares over all samples, in words."""

import dataclasses
import math

from backsight.description import Printed
from backsight.rounding import shortest

MARGIN = 10.0
"""An estimator may be off by so many times what the references are from each other: the estimator
goes another way, and rounds elsewhere."""

USELESS = 1e-3
"""References that differ by more than this, in standard deviations, settle nothing at all."""

LOST = 1e4
"""Digits that a covariance may lose where a wide prior meets a precise sensor: it is a small
difference of large numbers there. The estimates lose none."""


@dataclasses.dataclass(frozen=True)
class Claim(Printed):
    """Differences of one arrival cost, in standard deviations of the estimate.

    Parameters
    ----------
    name : str
        The estimator's own arrival cost, or another one in its place.
    own : bool
        Whether it is the estimator's own.
    x, P : float
        Largest difference to the Kalman filter over all samples, of the estimates and of the
        covariance per deviation and deviation.
    x_full, P_full : float
        Difference to least squares over all samples, at the last sample. All are infinite if the
        estimator cannot be built or diverges.
    """

    name: str
    own: bool
    x: float
    P: float
    x_full: float
    P_full: float

    @property
    def estimates(self) -> float:
        """Larger difference of the estimates."""
        return max(self.x, self.x_full)

    @property
    def covariances(self) -> float:
        """Larger difference of the covariances."""
        return max(self.P, self.P_full)


@dataclasses.dataclass(frozen=True)
class Certificate(Printed):
    """What `certify` found; prints itself.

    Parameters
    ----------
    estimator : str
        Its title.
    claims : tuple of Claim
        The estimator as it is, and with other arrival costs.
    references : float
        Largest difference of the estimates by the Kalman filter and by least squares at the last
        sample, in standard deviations: what rounding does to the comparison.
    samples, missing, seed : int, float, int
        Of the data: number, share that is not measured, and seed.
    lag : int
        Samples between the measurements that were used last and the estimate.
    at : dict
        State to the value at which the model is linearised.
    tolerance : float
        Largest difference that counts as none, of estimates; `LOST` times as much of covariances.
    left_out : tuple of str
        What of the estimator and its model the comparison does without.
    rounding : float
        The last digit of the largest state, in standard deviations: no difference is known better.
    """

    estimator: str
    claims: tuple[Claim, ...]
    references: float
    samples: int
    missing: float
    seed: int
    lag: int
    at: dict[str, float]
    tolerance: float
    left_out: tuple[str, ...] = ()
    rounding: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether the estimator as it is equals both references."""
        return all(self.verdict(c) == "equal" for c in self.claims if c.own)

    def equal(self, claim: Claim) -> bool:
        """Whether a claim holds; a difference that is not a number does not."""
        return claim.estimates <= self.tolerance and claim.covariances <= LOST * self.tolerance

    def told(self, claim: Claim) -> bool:
        """Whether the references agree well enough to say that a claim does not hold, or holds.

        They come from the same numbers by two routes, so that they must agree as well as what is
        asked of the estimator, and better than it differs from them.
        """
        if not self.references <= USELESS:
            return False
        if self.equal(claim):
            return self.references <= self.tolerance
        apart = claim.estimates > max(MARGIN * self._known(), self.tolerance)
        spread = claim.covariances > LOST * max(MARGIN * self.references, self.tolerance)
        return apart or spread

    def _known(self) -> float:
        """How well differences of estimates are known."""
        return max(self.references, self.rounding)

    def verdict(self, claim: Claim) -> str:
        """``equal``, ``differs`` or ``cannot tell``."""
        if not self.told(claim):
            return "cannot tell"
        return "equal" if self.equal(claim) else "differs"

    def lines(self) -> list[str]:
        """The result in sentences."""
        named = "Kalman filter" if self.lag == 0 else f"fixed-lag smoother (lag {self.lag})"
        own = next(c for c in self.claims if c.own)
        with_own = f" with {own.name}" if own.name else ""
        if not self.told(own):
            return [
                f"Whether {self.estimator}{with_own} equals the {named} and the full-information "
                f"estimate cannot be told: on the linearised model these two differ by "
                f"{self._known():.1e} standard deviations, by rounding alone, and the estimator "
                f"from them by {own.estimates:.1e}. A mode that grows or is much faster than the "
                "sampling, or scales far apart, are the usual reasons.",
                *self._without(),
            ]
        verb = "equals" if self.holds else "does NOT equal"
        found = [
            f"{self.estimator}{with_own} {verb} the {named} and the full-information estimate on "
            f"the linearised model: largest difference {own.estimates:.1e} standard deviations, of "
            f"the covariance {own.covariances:.1e} (allowed {self.tolerance:.0e} and "
            f"{LOST * self.tolerance:.0e})."
        ]
        others = [c for c in self.claims if not c.own]
        alike = [c.name for c in others if self.verdict(c) == "equal"]
        unlike = [_unlike(c) for c in others if self.verdict(c) == "differs"]
        if alike:
            found.append(f"It would also do so with {', '.join(alike)}.")
        if unlike:
            found.append(f"It would not with {', '.join(unlike)}.")
        return [*found, *self._without()]

    def _without(self) -> list[str]:
        if not self.left_out:
            return []
        return [
            f"Left out of the comparison, and of the claim: {', '.join(self.left_out)}. On the "
            "linearised model with additive Gaussian noise there is nothing to hold them against."
        ]

    def __str__(self) -> str:
        return "\n".join([self.table(), "", *self.lines()])

    def table(self) -> str:
        """All differences."""
        width = max(13, *(len(c.name) for c in self.claims)) + 8
        place = ", ".join(f"{name} = {shortest(value)}" for name, value in self.at.items())
        lines = [
            f"Certificate: {self.estimator}",
            f"linearised at {place}",
            f"{self.samples} samples of Gaussian data, {self.missing:.0%} not measured, seed "
            f"{self.seed}; the references differ by {self.references:.0e}",
            "",
            f"{'difference [σ] to the':<{width}}  {'Kalman filter':>20}  {'full information':>20}",
            f"{'':<{width}}  {'x':>9}  {'P':>9}  {'x':>9}  {'P':>9}",
        ]
        for c in self.claims:
            name = f"{c.name or 'as it is'}{' (own)' if c.own and c.name else ''}"
            numbers = "  ".join(f"{v:9.1e}" for v in (c.x, c.P, c.x_full, c.P_full))
            lines.append(f"{name:<{width}}  {numbers}  {self.verdict(c)}")
        return "\n".join(lines)


def _unlike(claim: Claim) -> str:
    if not math.isfinite(claim.estimates):
        return f"{claim.name} (not possible here)"
    return f"{claim.name} (estimate {claim.estimates:.1g} σ, covariance {claim.covariances:.1g})"
