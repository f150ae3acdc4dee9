"""Units as engineers write them: whether they are any, and how to come from one to another.

What pint knows is extended by the words of loggers, and by traps that it does not see: ``Nm`` is no
number per metre, ``cts`` are no carats, 1 Hz and 1/min are no radian per second, ``U/min`` are
revolutions, and decibels have no factor. What measures another thing than what is wanted is read as
its namesake that does: ``g`` of an accelerometer, ``lb`` of a load cell, ``C`` of a thermometer.
"""

import functools
import math
import re
from typing import Any, NamedTuple

from backsight.errors import BacksightError, nearest
from backsight.types import Array

PREFIX = "(?:da|[YZEPTGMkhdcmuµμnpf])?"
BASE = (
    "m|s|g|A|K|N|Pa|J|W|V|C|F|H|T|Hz|Ohm|Ω|rad|deg|°|°C|degC|°F|min|h|d|L|l|t|bar|psi|rpm|RPM|"
    "rev|cycles|in|ft|lb|lbf|kip|mile|mi|grav|dB|%|ppm|ue|strain|count|counts|sec|Sec|cts|"
    "Nm|Nmm|Ns|Nms"
)
_FACTOR = rf"{PREFIX}(?:{BASE}|1)(?:\^?[-+]?\d|[²³⁻¹]+)?"
PATTERN = re.compile(rf"{_FACTOR}(?:\s*[*/·. -]\s*\(?{_FACTOR}\)?)*")
"""Most units, without asking pint."""

WORDS = {
    "Ohm": "ohm",
    "grav": "standard_gravity",
    "g_n": "standard_gravity",
    "gn": "standard_gravity",
    "mgn": "millistandard_gravity",
    "cts": "count",
    "ue": "microstrain",
    "µe": "microstrain",
    "με": "microstrain",
    "µε": "microstrain",
    "RPM": "rpm",
    "rev": "revolution",
    "Sec": "second",
    "Sek": "second",
    "sek": "second",
    "cycles": "cycle",
    "U": "revolution",
    "r": "revolution",
    "dps": "degree/second",
    "kmh": "kph",
    "ips": "inch/second",
    "gpm": "gallon/minute",
    "kp": "kgf",
    "klbf": "kip",
    "lbm": "pound",
    "PS": "metric_horsepower",
    "pct": "percent",
    "Celsius": "degC",
    "celsius": "degC",
    **{f"K{unit}": f"k{unit}" for unit in ("N", "Pa", "W", "Hz", "V", "g", "m", "J", "Ohm")},
}
"""What is written, to what pint calls it."""

NAMESAKES = {
    "g": "standard_gravity",
    "G": "standard_gravity",
    "mg": "millistandard_gravity",
    "ug": "microstandard_gravity",
    "µg": "microstandard_gravity",
    "lb": "lbf",
    "lbs": "lbf",
    "C": "degC",
    "F": "degF",
    "mil": "thou",
    "mils": "thou",
    "gal": "Gal",
}
"""What a word means where its own meaning is of another kind than what is wanted.

A kilogram is no kilogram of force: that would hide a mistaken column.
"""

_GLUED = re.compile(
    r"(?P<force>(?:da|[kMGmuµn])?N)(?P<length>[cdm]?m)?(?P<time>s)?"
    r"|(?P<mass>kg|g)(?P<arm>(?(mass)[cm]?m))"
)
"""Units without a sign between them: ``Ncm``, ``kNs``, ``kgm``, ``gmm``."""

_DEGREES = re.compile(r"deg\.? ?(?=[CF]\b)", re.IGNORECASE)
_HYPHEN = re.compile(r"(?<=[^\W\d_])-(?=[^\W\d_])")
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "×": "*", "℃": "°C", "℉": "°F", "‰": " permille"})

_NAME = r"(?:[^\W\d_]+(?:_[^\W\d_]+)*|°\w?|%)"
_ANY = rf"[(]?(?:10*|{_NAME}(?:(?:\^|\*\*)?[-+]?\d|[²³⁻¹]+)?)[)]?"
GRAMMAR = re.compile(rf"{_ANY}(?: ?[*/·. -] ?{_ANY})*")
"""Names with one digit of a power: what goes to pint, which would also compute 9**9**9."""

LONGEST = 60
"""Characters of a unit."""

_TOKEN = re.compile(r"[^\W\d_²³¹]+|[°%]\w?")
_POWER = re.compile(r"(?<=[^\W\d_])\^?(-?\d+)")
_ANGLES = {"radian", "degree", "revolution", "turn", "revolutions_per_minute", "gradian"}
_FREQUENCIES = {"hertz", "cycle"}


class UnitError(BacksightError):
    """A unit that is none, or two that are of different kinds."""


class Conversion(NamedTuple):
    """A value in the new unit is ``factor * value + offset``."""

    factor: float
    offset: float = 0.0

    @property
    def same(self) -> bool:
        """Whether nothing changes."""
        return self.offset == 0.0 and math.isclose(self.factor, 1.0, rel_tol=1e-12)

    def applied(self, values: Array) -> Array:
        """Values in the new unit, of the same shape."""
        return values if self.same else self.factor * values + self.offset


def check_unit(unit: str) -> None:
    """Raise `UnitError` unless a text is a unit, or empty."""
    if unit.strip() in ("", "-", "1") or PATTERN.fullmatch(unit):
        return
    _parsed(unit)


def is_unit(unit: str) -> bool:
    """Whether a text is a unit, or empty."""
    try:
        check_unit(unit)
    except UnitError:
        return False
    return True


def convertible(given: str, wanted: str) -> bool:
    """Whether two units measure the same thing."""
    try:
        conversion(given, wanted)
    except UnitError:
        return False
    return True


def conversion(given: str, wanted: str) -> Conversion:
    """How to come from one unit to another.

    Raises
    ------
    UnitError
        If one is no unit, or they measure different things; a frequency in Hz and an angular one
        do, whose factor of 2 pi is for the user to decide.
    """
    if given == wanted:
        return Conversion(1.0)
    old, new = _parsed(given), _parsed(wanted)
    if old.dimensionality != new.dimensionality:  # g of a balance, or of an accelerometer
        readings = ((a, b) for a in _readings(given) for b in _readings(wanted))
        fitting = (r for r in readings if r[0].dimensionality == r[1].dimensionality)
        old, new = next(fitting, (old, new))
    if old.dimensionality != new.dimensionality or not _alike(old, new):
        raise UnitError(f"'{given}' cannot be converted to '{wanted}'")
    zero, one, two = (_registry().Quantity(v, old).to(new).magnitude for v in (0.0, 1.0, 2.0))
    if not math.isclose(two - one, one - zero, rel_tol=1e-9):
        raise UnitError(f"'{given}' is logarithmic: no factor leads to '{wanted}'")
    return Conversion(float(one - zero), float(zero))


def _readings(unit: str) -> list[Any]:
    """A unit as it is, and with words in the meaning of their namesakes."""
    other = _TOKEN.sub(lambda m: NAMESAKES.get(m[0], m[0]), unit)
    return [_parsed(unit)] if other == unit else [_parsed(unit), _parsed(other)]


class BaseUnits(NamedTuple):
    """A unit by those of the SI: a value in base units is ``factor * value + offset``."""

    powers: dict[str, int]
    factor: float
    offset: float


_SYMBOLS = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
    "candela": "cd", "radian": "rad",
}  # fmt: skip


def base_units(unit: str) -> BaseUnits | None:
    """Express a unit by powers of kg, m, s, A, K, mol, cd and rad.

    None if it is no unit that is known, has broken powers, or may mean several (g).
    """
    if unit.strip().strip("[]") == "g":
        return None
    try:
        old = _parsed(unit)
    except UnitError:
        return None
    zero, one = (_registry().Quantity(v, old).to_base_units() for v in (0.0, 1.0))
    powers = dict(one.unit_items())
    if any(name not in _SYMBOLS or power != int(power) for name, power in powers.items()):
        return None
    offset = float(zero.magnitude)
    named = {_SYMBOLS[name]: int(power) for name, power in powers.items()}
    return BaseUnits(named, float(one.magnitude) - offset, offset)


def _alike(old: Any, new: Any) -> bool:
    """Whether both count turns in the same way: pint takes Hz, rad/s and 1/s for one."""
    names = [{str(name) for name in unit._units} for unit in (old, new)]
    angles = [bool(n & _ANGLES) for n in names]
    cycles = [any(name.endswith(tuple(_FREQUENCIES)) for name in n) for n in names]
    if cycles[0] != cycles[1] and (angles[0] or angles[1]):
        return False
    plain = angles[0] != angles[1] and "[time]" in old.dimensionality
    if plain and "minute" in names[0 if angles[1] else 1]:
        return False  # 1/min may be revolutions
    turns = {"revolution", "turn", "revolutions_per_minute", "degree"}
    return not (plain and (names[0] | names[1]) & turns)


def _spelled(word: str) -> str:
    """What pint calls a word, or words without a sign between them."""
    if word in WORDS:
        return WORDS[word]
    glued = _GLUED.fullmatch(word)
    parts = [part for part in glued.groups() if part] if glued else []
    return "*".join(parts) if len(parts) > 1 else word


@functools.cache
def _parsed(unit: str) -> Any:
    import pint

    bare = _HYPHEN.sub("*", _DEGREES.sub("°", unit.strip().strip("[]").translate(_SIGNS).strip()))
    if len(bare) > LONGEST or not (bare in ("", "-") or GRAMMAR.fullmatch(bare)):
        raise UnitError(f"'{unit}' is no unit; write it as N, mm/s or kg m^2")
    text = _POWER.sub(r"**\1", _TOKEN.sub(lambda m: _spelled(m[0]), bare))
    try:
        return _registry().parse_units("" if text == "-" else text)
    except pint.UndefinedUnitError as error:
        for name in error.unit_names if not isinstance(error.unit_names, str) else [unit]:
            small = str(name).lower().rstrip("s")
            if hasattr(_registry(), small) and small.isidentifier():
                return _parsed(unit.replace(str(name), small))
        known = [*BASE.split("|"), *WORDS, "mm", "um", "kN", "mV", "kPa", "MPa", "kg"]
        hint = nearest(unit, known)
        hint = hint if "mean" in hint else "write it as N, mm/s or kg m^2, or leave it out"
        raise UnitError(f"'{unit}' is no unit that is known: {hint}") from None
    # What is no unit may fail in any way in the tokenizer.
    except Exception:
        raise UnitError(f"'{unit}' is no unit; write it as N, mm/s or kg m^2") from None


@functools.cache
def _registry() -> Any:
    import pint

    registry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
    registry.define("microstrain = 1e-6")
    if "permille" not in registry:  # newer versions of pint have it
        registry.define("permille = 1e-3")
    return registry
