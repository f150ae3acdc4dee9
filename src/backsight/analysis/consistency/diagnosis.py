"""What may be wrong with a result, in words: only as much as the numbers can tell."""

import math

from backsight.analysis.consistency._consistency import Consistency
from backsight.analysis.consistency._noise_factors import NoiseFactors
from backsight.analysis.consistency.whiteness import Colour
from backsight.rounding import significant

WEAK = 0.1
"""Correlations below this do no harm in practice, however certain they are."""

LITTLE = 0.02
"""Share of the innovations that inputs may explain without harm."""

NEAR = {"R": 1.3, "Q": 1.6}
"""A factor of the noise below this, or above its inverse, does no harm in practice."""

SURE = 4.0
"""Standard deviations by which a factor must differ from one; they come from ten parts only."""


def pattern(found: Consistency) -> str:
    """Say how the innovations hang together; empty if they do not, or so little that it is fine."""
    colour = found.coloured
    if colour is None or abs(colour.largest) < WEAK:
        return ""
    kind = "positively" if colour.largest > 0 else "negatively"
    of = f" of '{colour.output}'" if len(found.colours) > 1 else ""
    size = significant(colour.largest, 2)
    return f"innovations{of} are {kind} correlated (lag {colour.lag}: {size})"


def cause(found: Consistency, aligned: bool | None = None) -> str:
    """Say what is the likely cause of an inconsistency; empty if nothing can be said.

    Parameters
    ----------
    found : Consistency
    aligned : bool, optional
        Whether outputs and inputs belong to the same samples, if that is known.
    """
    driven = found.driven
    if driven is not None and driven.explained > LITTLE:
        return _answered(driven, aligned)
    colour = found.coloured
    coloured = colour is not None and abs(colour.largest) >= WEAK
    if found.noise is None:
        return _by_signs(found, colour.lag1 if colour is not None and coloured else 0.0)
    if coloured and found.noise.unexplained > 2 * WEAK:
        return (
            "no size of Q and R explains how they are correlated: the model lacks dynamics or a "
            "force, a parameter is wrong, or the noise is not white (filtered signals)"
        )
    certain = _by_factors(found.noise)
    if certain or found.consistent:
        return certain
    sure = (found.noise.R, found.noise.R_std), (found.noise.Q, found.noise.Q_std)
    told = all(_known(factor, std) for factor, std in sure)
    return "" if told else "whether Q or R is the cause cannot be told from them"


def _answered(colour: Colour, aligned: bool | None) -> str:
    samples = "one sample" if colour.delay == 1 else f"{colour.delay} samples"
    reason = {
        True: "the model answers its input wrongly, or the input is noisy (sigma_u)",
        False: "y and u are misaligned",
        None: "the model answers its input wrongly, or y and u are misaligned, or the input is "
        "noisy (sigma_u)",
    }[aligned]
    return (
        f"past inputs explain {significant(100 * colour.explained, 2)} % of the innovations of "
        f"'{colour.output}', most of it '{colour.input}' {samples} earlier: {reason}; Q and R "
        "cannot be judged before that is mended"
    )


def _by_signs(found: Consistency, lag1: float) -> str:
    """Cause by size and sign alone, where the factors of the noise are not known."""
    ratio = found.mean_nis / found.nis_expected
    larger, smaller = (not found.sized and ratio > 1.0), (not found.sized and ratio < 1.0)
    if abs(lag1) < WEAK:
        if larger or smaller:
            return f"Q and R are both too {'small' if larger else 'large'}, or one of them by far"
        return ""
    if lag1 > 0:
        if larger:
            return "the process noise Q is too small"
        if smaller:
            return "R is too large"
        return "the process noise Q is too small for this R"
    if larger:
        return "R is too small"
    if smaller:
        return "the process noise Q is too large"
    return "the process noise Q is too large for this R"


def _by_factors(noise: NoiseFactors) -> str:
    R, Q = _wrong("R", noise.R, noise.R_std), _wrong("Q", noise.Q, noise.Q_std)
    if R and Q and noise.Q > 0 and 1 / NEAR["Q"] < noise.R / noise.Q < NEAR["Q"]:
        return f"Q and R are both {R}"
    if R and Q:
        return f"R is {R} and the process noise Q {Q}"
    if R:
        doubt = "" if _known(noise.Q, noise.Q_std) else "; whether Q fits cannot be told from them"
        return f"R is {R}{doubt}"
    if Q:
        doubt = "" if _known(noise.R, noise.R_std) else "; whether R fits cannot be told from them"
        return f"the process noise Q is {Q}{doubt}"
    return ""


def _known(factor: float, std: float) -> bool:
    return std < 0.5 * factor


def _wrong(name: str, factor: float, std: float) -> str:
    """``about 4.0 times too small``, or empty if the factor may be one."""
    if math.isnan(factor) or abs(factor - 1.0) < SURE * std:
        return ""
    near = NEAR[name]
    if 1 / near < factor < near:
        return ""
    if factor < 1e-4:
        return "far too large"
    size, word = (factor, "small") if factor > 1 else (1 / factor, "large")
    return f"about {significant(size, 2 if std < 0.15 * factor else 1)} times too {word}"
