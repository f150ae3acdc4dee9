"""Numbers as text, with as many digits as they deserve."""

import math

_PLAIN = range(-3, 6)  # powers of ten that are written without an exponent
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def significant(value: float, digits: int = 4) -> str:
    """Return the number with so many significant digits: ``95.11``, ``6.020 × 10⁶``."""
    if not math.isfinite(value):
        return _not_finite(value)
    if value == 0.0:
        return "0"
    exponent = _exponent(value, digits)
    if exponent in _PLAIN:
        return _signed(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    return f"{_signed(f'{value / 10.0**exponent:.{digits - 1}f}')} × {_power(exponent)}"


def plus_minus(value: float, std: float) -> str:
    """Return value and standard deviation, both to two digits of the latter: ``95.11 ± 0.12``."""
    if not (math.isfinite(value) and math.isfinite(std) and std > 0.0):
        return significant(value)
    last = _exponent(std, 2) - 1
    exponent = max(_exponent(value, 6) if value else last, last + 1)
    if last < exponent - 7:
        return f"{significant(value, 8)} ± {significant(std, 2)}"
    if exponent in _PLAIN and -6 < last < 2:
        places = max(-last, 0)
        return f"{_signed(f'{value:.{places}f}')} ± {std:.{places}f}"
    scale, places = 10.0**exponent, exponent - last
    body = f"{_signed(f'{value / scale:.{places}f}')} ± {std / scale:.{places}f}"
    return f"({body}) × {_power(exponent)}"


def between(value: float, low: float, high: float) -> str:
    """Return value and ends of its band, to two digits of its half: ``2.0 (1.6 to 2.5)``."""
    if not (math.isfinite(value) and low < value < high):
        return significant(value)
    digits = _exponent(value, 4) - _exponent(min(value - low, high - value), 2) + 2
    shown = [significant(v, max(2, min(digits, 8))) for v in (value, low, high)]
    return f"{shown[0]} ({shown[1]} to {shown[2]})"


def shortest(value: float) -> str:
    """Return the number as it would be given, with at most six digits: ``203.5``."""
    if not math.isfinite(value):
        return _not_finite(value)
    mantissa, _, exponent = f"{value:.6g}".partition("e")
    return _signed(mantissa) + (f" × {_power(int(exponent))}" if exponent else "")


def grouped(number: int) -> str:
    """Return a whole number in groups of three digits, with narrow spaces: ``24 841``."""
    return f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def percent(fraction: float) -> str:
    """Return a signed percentage: ``+0.32 %``, ``−12 %``."""
    if not math.isfinite(fraction):
        return _not_finite(fraction)
    number = 100.0 * fraction
    places = 0 if abs(number) >= 10 else 1 if abs(number) >= 1 else 2
    return _signed(f"{number:+.{places}f}") + " %"


def _exponent(value: float, digits: int) -> int:
    """Power of ten of the first digit, after rounding to so many digits."""
    return int(f"{value:.{digits - 1}e}".split("e")[1])


def _power(exponent: int) -> str:
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _not_finite(value: float) -> str:
    return "–" if math.isnan(value) else _signed(f"{value:+}".replace("inf", "∞"))
