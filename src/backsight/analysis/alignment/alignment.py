"""Whether outputs and inputs of a recording belong to the same samples."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy

from backsight.analysis.alignment.alignment_scale import PLAUSIBLE, Ratio
from backsight.description import Printed
from backsight.rounding import significant
from backsight.types import Array

PARTS = 40
"""Parts of the recording that vote."""

CHANCE = 1e-4
"""Probability below which a majority of the parts is no accident (ten shifts are tried)."""

WORTH = 0.02
"""Gain of log-likelihood per measured value below which a shift is not worth mentioning."""

MUCH = 100.0
"""Ratio of innovations beyond which the number says nothing more."""

PARTLY = 0.25
"""Fraction of a sample that is worth mentioning."""

SURE = 5.0
"""Standard deviations from which on a delay of a part of a sample is none by chance."""


@dataclasses.dataclass(frozen=True)
class Alignment(Printed):
    """What was found out about the times and units of a recording; prints itself.

    Parameters
    ----------
    shifts : tuple of int
        Numbers of samples by which y was moved to earlier ones.
    likelihood : tuple of float
        Mean log-likelihood per measured value of each, its size of innovations fitted; relative to
        that of no shift.
    votes : tuple of float
        Share of the parts of the recording in which each is better than no shift.
    size : tuple of float
        Root mean square of the normalised innovations of each.
    parts : int
        Number of parts that voted.
    ratios : tuple of Ratio
        Size and sign of every measured output.
    fine : (float, float) or None
        Delay of y with fractions of a sample and its standard deviation, where it can be told.
    channels : tuple of (str, Alignment)
        What was found with each output moved by itself, if there are several.
    explained : bool
        Whether the recording is explained without a shift: by parameters from another start, or by
        another estimator.
    """

    shifts: tuple[int, ...]
    likelihood: tuple[float, ...]
    votes: tuple[float, ...]
    size: tuple[float, ...]
    parts: int
    ratios: tuple[Ratio, ...]
    fine: tuple[float, float] | None = None
    channels: tuple[tuple[str, "Alignment"], ...] = ()
    explained: bool = False

    @property
    def best(self) -> int:
        """Shift with the largest likelihood [samples]; 0 if none was tried."""
        return self.shifts[int(np.argmax(self.likelihood))] if self.shifts else 0

    @property
    def delay(self) -> int:
        """Samples by which y is late with certainty; negative if it is early."""
        if not self.late or self.single:
            return 0
        return self.best if abs(self.best) < max(self.shifts) else 0

    @property
    def single(self) -> bool:
        """Whether moving one output explains more than moving all of them."""
        gains = [max(a.likelihood) for _, a in self.channels if a.late and not self.explained]
        return bool(gains) and max(gains) > (max(self.likelihood) if self.late else 0.0)

    @property
    def fraction(self) -> float:
        """Delay of y [samples], with fractions where the innovations tell them."""
        if self.fine is not None:
            return self.fine[0]
        at = self.shifts.index(self.best) if self.shifts else 0
        if not 0 < at < len(self.shifts) - 1:
            return float(self.best)
        before, here, after = (self.size[i] ** 2 for i in (at - 1, at, at + 1))
        bend = before - 2 * here + after
        # A parabola with its vertex within half a sample has neighbours of at most 9 : 1.
        even = max(before, after) <= 9 * min(before, after)
        return self.best + (0.5 * (before - after) / bend if even and bend > 0 else 0.0)

    @property
    def aligned(self) -> bool | None:
        """Whether no shift is best for certain, or some is; None if neither can be told."""
        if self.shifts and self.best == 0 and self._clear() and not self.single:
            return True
        return False if self.delay or self.single else None

    @property
    def sound(self) -> bool:
        """Whether neither a delay nor a wrong unit or sign is certain."""
        return not self.late and not self.single and not any(r.sentence() for r in self.ratios)

    @property
    def late(self) -> bool:
        """Whether another shift is better for certain, even if it may be that of the search."""
        return bool(self.shifts) and self._certain(self.best) and not self.explained

    def remedies(self, dt: float) -> list[str]:
        """What to put into a problem file, a line each, where a delay is certain; `dt` is in s."""
        whole = f"delay = {significant(self.fraction * dt, 3)}" if self.delay else ""
        if not self.single:
            return [f"Into every output of [recording]: {whole}"] if whole else []
        late = [(name, a.delay) for name, a in self.channels if a.late and a.delay]
        return [
            f"Into recording.outputs.{name}: delay = {significant(delay * dt, 3)}"
            for name, delay in late
        ]

    def lines(self) -> list[str]:
        """One sentence on the times, and one on the sizes or on every output that is wrong."""
        wrong = [f"{text[0].upper()}{text[1:]}." for r in self.ratios if (text := r.sentence())]
        late = max(self.channels, key=lambda c: max(c[1].likelihood, default=0.0), default=None)
        timing = [_alone(*late) if late is not None and self.single else self._timing()]
        return [*timing, *(wrong or [self._sizes()])]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _certain(self, shift: int) -> bool:
        """Whether another shift than none is better, and not by chance."""
        if shift == 0:
            return False
        at = self.shifts.index(shift)
        return self.likelihood[at] > WORTH and _chance(self.votes[at], self.parts) < CHANCE

    def _clear(self) -> bool:
        """Whether one sample more and one less are both worse, and not by chance.

        One with which the filter diverged tells nothing.
        """
        if not {-1, 1} <= set(self.shifts):
            return False
        both = [self.shifts.index(s) for s in (-1, 1)]
        return all(_chance(1.0 - self.votes[i], self.parts) < CHANCE for i in both)

    def _timing(self) -> str:
        if not self.shifts:
            return "Alignment of y and u: not judged, the model has no input or the run diverged."
        if self.delay:
            return self._misaligned()
        if self.explained:
            return (
                "Alignment of y and u: cannot be told; without a shift other parameters explain "
                "it, or those found have no meaning: narrow the prior, or use positive = true."
            )
        if self._certain(self.best):
            return (
                f"Alignment of y and u: the prediction is best with y shifted by {-self.best:+d} "
                "samples, the end of the search; look for a large delay, or for dynamics that the "
                "model lacks."
            )
        if not self.aligned:
            return self._between()
        times = significant(min(self._worse(-1), self._worse(1), MUCH), 2)
        text = (
            "y and u are aligned: one sample more or less makes the innovations at least "
            f"{times} times as large"
        )
        part = abs(self.fraction)
        if part < PARTLY or (self.fine is not None and part < 3 * self.fine[1]):
            return f"{text}."
        word = "late" if self.fraction > 0 else "early"
        band = "" if self.fine is None else f" ± {significant(self.fine[1], 1)}"
        return (
            f"{text}, though y may be about {part:.2g}{band} of a sample {word}: is the input held "
            "between samples or interpolated, as the estimators assume?"
        )

    def _between(self) -> str:
        """What is to be said where two whole shifts fit equally."""
        if self.fine is None or not SURE * self.fine[1] < abs(self.fine[0]) < 1:
            return "Alignment of y and u: cannot be told from this recording, shifts fit equally."
        part, band = abs(self.fine[0]), significant(self.fine[1], 1)
        word = "late" if self.fine[0] > 0 else "early"
        return (
            f"y is probably {part:.2f} ± {band} of a sample {word}, between two whole shifts: is "
            "the input held between samples or interpolated, as the estimators assume? Otherwise "
            "give the outputs this delay, in seconds."
        )

    def _worse(self, shift: int) -> float:
        """Size of the innovations with a shift, relative to that without."""
        none = self.size[self.shifts.index(0)]
        return self.size[self.shifts.index(shift)] / none if none > 0 else math.inf

    def _misaligned(self) -> str:
        count, word = abs(self.delay), "late" if self.delay > 0 else "early"
        samples = "one sample" if count == 1 else f"{count} samples"
        times = 1 / self._worse(self.delay)
        better = significant(times, 2) if times < MUCH else f"more than {MUCH:g}"
        nearest = ""
        if self.fine is not None and abs(self.fine[0] - self.delay) > max(0.1, 3 * self.fine[1]):
            samples = f"{abs(self.fine[0]):.2f} ± {significant(self.fine[1], 1)} samples"
            nearest = ", the nearest whole number"
        return (
            f"y and u are probably misaligned by {samples}: y is {word} (shift y by "
            f"{-self.delay:+d}{nearest}; its innovations are then {better} times smaller)."
        )

    def _sizes(self) -> str:
        known = [r for r in self.ratios if r.known]
        if not known:
            return (
                "Units and signs cannot be compared, since the model without measurements moves "
                "differently (its start or its parameters are not known well enough for that)."
            )
        listed = ", ".join(f"'{r.output}' {significant(r.size, 2)}" for r in known)
        return (
            f"Units and signs look right: {listed} times the model's response to the input "
            f"(a wrong unit is suspected outside {1 / PLAUSIBLE:g} to {PLAUSIBLE:g})."
        )


def decide(
    scores: Mapping[int, Array], size: Mapping[int, float], ratios: tuple[Ratio, ...]
) -> Alignment:
    """Compare the shifts sample by sample.

    Parameters
    ----------
    scores : dict
        Shift to the log-likelihood per measured value of every sample, (n,); of the same samples
        for all shifts. A shift with which the filter diverged is left out.
    size : dict
        Shift to the root mean square of its normalised innovations.
    ratios : tuple of Ratio
    """
    if 0 not in scores or len(scores) < 3:
        return Alignment((), (), (), (), 0, ratios)
    shifts = tuple(sorted(scores))
    gains = {s: scores[s] - scores[0] for s in shifts}
    parts = min(PARTS, len(scores[0]) // 5)
    voted = {s: np.array([p.mean() for p in np.array_split(g, parts)]) for s, g in gains.items()}
    return Alignment(
        shifts=shifts,
        likelihood=tuple(float(gains[s].mean()) for s in shifts),
        votes=tuple(float((voted[s] > 0).mean()) for s in shifts),
        size=tuple(size[s] for s in shifts),
        parts=parts,
        ratios=ratios,
    )


def _alone(name: str, found: Alignment) -> str:
    """What is to be said of an output that is late by itself."""
    if not found.delay:
        return (
            f"'{name}' by itself is predicted best with a shift by {-found.best:+d} samples, the "
            "end of the search; look for a large delay of this channel."
        )
    word = "late" if found.delay > 0 else "early"
    count = abs(found.delay)
    return (
        f"'{name}' is probably {word} by {count} sample{'s' if count > 1 else ''} against the "
        f"other outputs and the input (shift '{name}' by {-found.delay:+d})."
    )


def _chance(share: float, parts: int) -> float:
    """Probability of at least such a majority among parts that vote at random."""
    won = round(share * parts)
    return 1.0 if won == 0 else float(scipy.special.bdtrc(won - 1, parts, 0.5))
