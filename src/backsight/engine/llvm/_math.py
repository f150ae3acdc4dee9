"""Exponential, logarithm, tanh, sine and cosine in LLVM's language, on numbers or on lanes.

A call of the C library saves and restores registers and is made for every lane by itself. These
functions are short straight lines that become part of the leaf. Their results are within 3 units in
the last place for all arguments, most within one; infinity, NaN, underflow and overflow are as in
the C library. The sign of zero is kept by tanh only.

Arguments are reduced with constants that are cut into parts (Cody and Waite, *Software Manual for
the Elementary Functions*, 1980). These instructions must stay in the order in which they are
written: they carry none of the flags that leaves allow themselves. What remains is a Taylor series,
shortened in Chebyshev polynomials on the interval that is needed.
"""

import functools
import math
import struct
from collections.abc import Callable, Sequence

from numpy.polynomial import Chebyshev, Polynomial

from backsight.engine.llvm._numbers import BIAS, MANTISSA, Numbers
from backsight.engine.llvm._text import Text
from backsight.engine.llvm.width import Width

LN2 = 0xB17217F7D1CF79ABC9E3B39803F2F6AF
"""ln 2 in units of 2**-128."""

HALF_PI = 0xC90FDAA22168C234C4C6628B80DC1CD129024E088A67CC74
"""pi / 2 in units of 2**-191."""

FARTHEST = 2.0**40
"""Largest argument of sine and cosine that is reduced here; the C library serves larger ones."""


def write_math(name: str, width: Width) -> str:
    """Write ``@math.exp``, ``@math.log`` ... as a function of a number, or of one in every lane."""
    kind, text = width.number, Text()
    result = FUNCTIONS[name](Numbers(text, width), "%x")
    head = f"define internal {kind} @math.{name}({kind} %x) alwaysinline nounwind {width.attribute}"
    return text.function(head, f"{kind} {result}")


def _exp(n: Numbers, x: str) -> str:
    """exp(k ln 2 + r) = 2**k exp(r), with 2**k as a product, since it may be out of range."""
    least, largest = n.constant(-746.0), n.constant(710.0)
    x = n.when("ogt", x, largest, largest, x)
    x = n.when("olt", x, least, least, x)
    k, r = _without_powers_of_two(n, x)
    half, _ = n.nearest(k, 0.5)
    value = n.add(_expm1(n, r), n.constant(1.0))
    value = n.mul(value, n.power_of_two(half))
    return n.mul(value, n.power_of_two(n.sub(k, half)))


def _tanh(n: Numbers, x: str) -> str:
    """tanh(x) = -e / (e + 2) with e = exp(-2 x) - 1 for x > 0; from x = 22 on it is 1."""
    size, one = n.intrinsic("fabs", x), n.constant(1.0)
    size = n.when("ogt", size, n.constant(22.0), n.constant(22.0), size)
    k, r = _without_powers_of_two(n, n.mul(size, n.constant(-2.0)))
    power = n.power_of_two(k)
    e = n.fused(_expm1(n, r), power, n.sub(power, one))
    return n.intrinsic("copysign", n.div(e, n.add(e, n.constant(2.0))), x)


def _without_powers_of_two(n: Numbers, x: str) -> tuple[str, str]:
    """Whole number k, and r with x = k ln 2 + r, at most half of ln 2 large."""
    k, _ = n.nearest(x, 1 / math.log(2))
    back = n.neg(k)
    high, low = _ln2(n)
    return k, n.fused(back, low, n.fused(back, high, x))


def _expm1(n: Numbers, r: str) -> str:
    tail = n.fused(r, n.polynomial(r, _series()["exp"]), n.constant(0.5))
    return n.fused(n.mul(r, r), tail, r)


def _log(n: Numbers, x: str) -> str:
    """log(2**k (1 + f)), 1 + f between the square roots of 1/2 and 2.

    With s = f / (2 + f) it is log(1 + f) = 2 atanh(s) = f - g + s (g + 2 s**2 (1/3 + s**2/5 ...)),
    where g is half the square of f.
    """
    zero, least, infinity = (n.constant(c) for c in (0.0, 2.0**-1022, math.inf))
    scaled = n.when("olt", x, least, n.mul(x, n.constant(2.0**54)), x)
    root, whole = _bits(math.sqrt(0.5)), 2.0**MANTISSA
    moved = n.on_bits("add", n.bits(scaled), (BIAS << MANTISSA) - root)
    fraction = n.on_bits("and", moved, (1 << MANTISSA) - 1)
    f = n.sub(n.of_bits(n.on_bits("add", fraction, root)), n.constant(1.0))
    exponent = n.of_bits(n.on_bits("or", n.on_bits("lshr", moved, MANTISSA), _bits(whole)))
    origin = n.constant(whole + BIAS)
    k = n.sub(exponent, n.when("olt", x, least, n.constant(whole + BIAS + 54), origin))
    s = n.div(f, n.add(f, n.constant(2.0)))
    square, g = n.mul(s, s), n.mul(n.mul(f, f), n.constant(0.5))
    series = n.fused(square, n.polynomial(square, _series()["log"]), g)
    high, low = _ln2(n)
    small = n.sub(g, n.fused(s, series, n.mul(k, low)))
    result = n.sub(n.mul(k, high), n.sub(small, f))
    result = n.when("olt", x, infinity, result, x)
    result = n.when("oeq", x, zero, n.constant(-math.inf), result)
    return n.when("olt", x, zero, n.constant(math.nan), result)


def _sine(n: Numbers, x: str, *, name: str, quarters: int) -> str:
    """Sine of x and some quarters of a turn; very large angles are left to the C library."""
    near = n.compare("ole", n.intrinsic("fabs", x), n.constant(FARTHEST))
    kind, value = n.width.number, _near_sine(n, x, quarters)
    library = f"@{name}" if n.width.lanes == 1 else f"@lanes.{name}"

    def mend() -> str:
        far = n.text.new(f"call {kind} {library}({kind} {x})")
        return n.choose(near, value, far)

    return n.text.mended(n.everywhere(near), kind, value, mend)


def _near_sine(n: Numbers, x: str, quarters: int) -> str:
    k, shifted = n.nearest(x, 2 / math.pi)
    r, rest = _without_quarters(n, x, n.neg(k))
    square = n.mul(r, r)
    half = n.mul(square, n.constant(0.5))
    main = n.sub(n.constant(1.0), half)
    cubic = n.mul(n.mul(square, r), n.polynomial(square, _series()["sin"]))
    sine = n.add(r, n.fused(rest, main, cubic))
    lost = n.sub(n.sub(n.constant(1.0), main), half)
    quartic = n.mul(n.mul(square, square), n.polynomial(square, _series()["cos"]))
    cosine = n.add(main, n.add(lost, n.fused(n.neg(r), rest, quartic)))
    quarter = n.on_bits("add", n.bits(shifted), quarters)
    odd = n.on_bits("icmp ne", n.on_bits("and", quarter, 1), 0)
    value = n.bits(n.choose(odd, cosine, sine))
    sign = n.on_bits("shl", n.on_bits("and", quarter, 2), 62)
    return n.of_bits(n.text.new(f"xor {n.width.whole} {value}, {sign}"))


def _without_quarters(n: Numbers, x: str, back: str) -> tuple[str, str]:
    """Return x + back pi/2 as a number and what rounding lost of it, even if little is left."""
    high, middle, low = (n.constant(part) for part in _parts(HALF_PI, 191, (53, 53, 53)))
    first = n.exactly(back, high, x)
    second = n.mul(back, middle)
    r = n.add(first, second)
    added = n.sub(r, first)
    rest = n.add(n.sub(first, n.sub(r, added)), n.sub(second, added))
    rest = n.add(rest, n.exactly(back, middle, n.neg(second)))
    return r, n.fused(back, low, rest)


FUNCTIONS: dict[str, Callable[[Numbers, str], str]] = {
    "exp": _exp,
    "log": _log,
    "tanh": _tanh,
    "sin": functools.partial(_sine, name="sin", quarters=0),
    "cos": functools.partial(_sine, name="cos", quarters=1),
}
"""What is written here, by its name in `backsight.engine.program.leaf.OPERATIONS`."""


@functools.cache
def _series() -> dict[str, list[float]]:
    """Coefficients of what the functions above leave to a polynomial."""
    inverse = [1 / math.factorial(k) for k in range(20)]
    turning = [(-1) ** (k // 2) * c for k, c in enumerate(inverse)]
    half, eighth = math.log(2) / 2, math.pi / 4
    return {
        "exp": _shortened(inverse[3:], (-half, half), 9),
        "log": _shortened([2 / k for k in range(3, 27, 2)], (0.0, (3 - math.sqrt(8)) ** 2), 7),
        "sin": _shortened(turning[3::2], (0.0, eighth**2), 6),
        "cos": _shortened(turning[4::2], (0.0, eighth**2), 6),
    }


def _shortened(series: Sequence[float], interval: tuple[float, float], terms: int) -> list[float]:
    """Coefficients of a polynomial that is nearly the best one on the interval."""
    best = Polynomial(series).convert(kind=Chebyshev, domain=interval).truncate(terms)
    return best.convert(kind=Polynomial).coef.tolist()


def _ln2(n: Numbers) -> tuple[str, str]:
    """Two parts of ln 2; a product of the first with an exponent is exact."""
    high, low = _parts(LN2, 128, (32, 53))
    return n.constant(high), n.constant(low)


def _parts(value: int, scale: int, sizes: Sequence[int]) -> list[float]:
    """Cut a number in units of 2**-scale into parts of so many bits."""
    parts = []
    for size in sizes:
        drop = max(value.bit_length() - size, 0)
        parts.append(math.ldexp(value >> drop, drop - scale))
        value &= (1 << drop) - 1
    return parts


def _bits(value: float) -> int:
    return struct.unpack("<q", struct.pack("<d", value))[0]
