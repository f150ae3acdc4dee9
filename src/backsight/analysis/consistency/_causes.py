"""What may be wrong with a result, in words: only as much as the numbers can tell."""

from backsight.analysis.consistency._consistency import WEAK, Consistency
from backsight.analysis.consistency._noise_factors import LIKELY, NEAR_Q, NoiseFactors
from backsight.analysis.consistency.whiteness import Colour
from backsight.rounding import significant

_MEND = "say how much (sigma_u)"
_NOISY = f", or the input is measured with noise: then {_MEND}"


def pattern(found: Consistency) -> str:
    """Say how the innovations hang together; empty if they do not, or so little that it is fine."""
    colour = found.coloured
    if colour is None:
        return ""
    kind = "positively" if colour.largest > 0 else "negatively"
    of = f" of '{colour.output}'" if len(found.colours) > 1 else ""
    size = significant(colour.largest, 2)
    return f"innovations{of} are {kind} correlated (lag {colour.lag}: {size})"


def cause(found: Consistency, aligned: bool | None = None) -> str:
    """Say what is the likely cause of an inconsistency; empty if there is none, or nobody knows.

    Parameters
    ----------
    found : Consistency
    aligned : bool, optional
        Whether outputs and inputs belong to the same samples, if that is known.
    """
    if found.consistent:
        return ""
    noisy, driven = found.noisy, found.driven
    if noisy is not None and aligned is not False:
        return "; ".join(text for text in (_noise_of_input(noisy), _of_noise(found)) if text)
    if driven is not None:
        return _answered(driven, aligned)
    return _of_noise(found)


def _noise_of_input(colour: Colour) -> str:
    share = significant(100 * colour.noise, 2)
    return (
        f"what is new in the input '{colour.noisy}' explains {share} % of the innovations of "
        f"'{colour.output}', more than its whole past does: it is measured with noise, "
        f"{_MEND}, unless a controller makes it from the outputs"
    )


def _of_noise(found: Consistency) -> str:
    """Cause by the noise that was assumed."""
    colour = found.coloured
    if found.noise is None:
        return _by_signs(found, 0.0 if colour is None else colour.lag1)
    if colour is not None and found.noise.unexplained > 2 * WEAK:
        return (
            "no size of Q and R explains how they are correlated: the model lacks dynamics or a "
            "force, a parameter is wrong, or the noise is not white (filtered signals)"
        )
    certain = _by_factors(found.noise)
    if certain:
        return certain
    sure = (found.noise.R, found.noise.R_std), (found.noise.Q, found.noise.Q_std)
    told = all(_known(factor, std) for factor, std in sure)
    return "" if told else "whether Q or R is the cause cannot be told from them"


def _answered(colour: Colour, aligned: bool | None) -> str:
    samples = "one sample" if colour.delay == 1 else f"{colour.delay} samples"
    reason = {
        True: f"the model answers its input wrongly{_NOISY}",
        False: "y and u are misaligned",
        None: f"the model answers its input wrongly, or y and u are misaligned{_NOISY}",
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
    R = _size(noise.R, noise.R_std) if noise.R_wrong(LIKELY) else ""
    Q = _size(noise.Q, noise.Q_std) if noise.Q_wrong(LIKELY) else ""
    if R and Q and noise.Q > 0 and 1 / NEAR_Q < noise.R / noise.Q < NEAR_Q:
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


def _size(factor: float, std: float) -> str:
    """``about 4.0 times too small``."""
    if factor < 1e-4:
        return "far too large"
    size, word = (factor, "small") if factor > 1 else (1 / factor, "large")
    return f"about {significant(size, 2 if std < 0.15 * factor else 1)} times too {word}"
