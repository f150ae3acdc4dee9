"""Change what is right a little: trees of a problem file, texts, bytes."""

import copy
import math
import random
import re
from collections.abc import Mapping
from typing import Any


class Raw(str):
    """TOML of a value, as it stands."""


ODD: list[Any] = [
    0, 1, -1, 2, 255, 10**6, 2**31, 2**63 - 1, 2**63, -(10**20), Raw("1" + "0" * 400), True,
    0.0, -0.0, 1e-300, 5e-324, 1e150, 1e300, 1.8e308, -1e300, 1e-15, math.nan, math.inf, -math.inf,
    Raw("1e400"), Raw("0x1F"), Raw("1979-05-27"), Raw("1979-05-27T07:32:00Z"), Raw("07:32:00"),
    "", " ", "a", "q", "v", "k", "y", "é", "日本", "x" * 300, "a\nb", "a\0b", "\u202e", "nan",
    "<script>alert(1)</script>", "[red]x", "a/b", "../x", ".", "/dev/zero", "None", "sin(q)",
    "q**2", "1/0", "-k*q", "k*", "((((q))))", "q.v", "__import__('os')", "9**9**9**9", "%s%n{0}",
    "${HOME}", "'", '"', "\\", "m/s^2", "kg m^99999999", "degC", "mV/V", "(" * 50 + "m", "µm",
    "1/1/1/1", "m^-9", "dB", "rpm", "zoh", "foh", "rk4", "ekf", "mho", "mhe", "csmhe", "kf", "live",
    [], [[]], [1], [1.0, 2.0], [[1.0]], [[1.0, 0.0], [0.0, 1.0]], [[1.0, 2.0], [3.0]], ["a"],
    [math.nan], [math.inf], ["1", 2], [[["a"]]], [{}], [[1e308, 1e308], [1e308, 1e308]], {},
    {"a": 1}, {"kind": "ekf"}, {"kind": "matern", "sigma": 1.0, "length": 1e-300}, {"kind": "gate"},
    {"value": 1.0}, {"column": "x"}, {"": 1}, {"a": {"b": {"c": {}}}}, {"y": 1.0},
    {"q": 1.0, "v": 1.0}, {"path": "k.mtx"}, {"expression": "q"}, {"name": "k"}, ["k", "sigma_y"],
]  # fmt: skip
"""Values of every kind in places where they are not meant to be."""

KEYS = ["", "a", "q", "v", "y", "k", "N", "kind", "column", "unit", "é", "a b", "a.b", "x" * 200,
        "__class__", "self", "sin", "pi", "1", "noise", "prior", "at", "name", "lower"]  # fmt: skip

PIECES = ["[", "]", "{", "}", '"', "'", "=", ".", ",", "\n", "\r", "\t", "#", "\\", '"""', "'''",
          "\0", "\ufeff", "é", "1e999", "[[", "]]", "-", "+", "_", "inf", "nan", "0x", "\\u0000",
          "\\ud800", "2020-01-01", "9" * 5000, ";", "%", "(", ")", "*", "^", "/", "°"]  # fmt: skip
"""What texts have a meaning for."""

DEEPEST = 6
"""Tables that are written as such; deeper ones are inline."""


def text_of(tree: Mapping[str, Any]) -> str:
    """A tree as TOML, each value with all its keys."""
    lines = []

    def go(before: tuple[str, ...], table: Mapping[str, Any]) -> None:
        for key, value in table.items():
            here = (*before, _key(key))
            if isinstance(value, dict) and value and len(here) < DEEPEST:
                go(here, value)
            else:
                lines.append(f"{'.'.join(here)} = {_value(value)}")

    go((), tree)
    return "\n".join(lines) + "\n"


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quoted(key)


def _quoted(text: str) -> str:
    def shown(c: str) -> str:
        if c in '"\\':
            return f"\\{c}"
        return f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c

    return f'"{"".join(map(shown, text))}"'


def _value(value: Any) -> str:
    match value:
        case Raw():
            return str(value)
        case bool():
            return str(value).lower()
        case float():
            return repr(value)
        case str():
            return _quoted(value)
        case list():
            return f"[{', '.join(map(_value, value))}]"
        case dict():
            return f"{{{', '.join(f'{_key(k)} = {_value(v)}' for k, v in value.items())}}}"
    return str(value)


def _places(tree: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = tree.items() if isinstance(tree, dict) else ()
    items = enumerate(tree) if isinstance(tree, list) else items
    found = []
    for key, value in items:
        found += [(*here, key), *_places(value, (*here, key))]
    return found


def _at(tree: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        tree = tree[key]
    return tree


def mutated_tree(tree: Mapping[str, Any], draw: random.Random) -> dict[str, Any]:
    """A copy of a tree in which one to three things are different."""
    changed = copy.deepcopy(dict(tree))
    for _ in range(draw.choice([1, 1, 1, 2, 2, 3])):
        places = _places(changed)
        if not places:
            break
        place = draw.choice(places)
        _change(changed, _at(changed, place[:-1]), place[-1], places, draw)
    return changed


def _change(
    tree: Any, table: Any, key: Any, places: list[tuple[Any, ...]], draw: random.Random
) -> None:
    value, how = table[key], draw.random()
    if how < 0.12:
        del table[key]
    elif how < 0.20 and isinstance(table, dict):
        new = draw.choice([*KEYS, f"{key}x", str(key)[:-1], str(key).upper()])
        items = [(new if k == key else k, v) for k, v in table.items()]
        table.clear()
        table.update(items)
    elif how < 0.28 and isinstance(table, dict):
        table[draw.choice(KEYS)] = copy.deepcopy(draw.choice(ODD))
    elif how < 0.60 and not isinstance(value, bool | dict):
        table[key] = _alike(value, draw)
    elif how < 0.66:
        table[key] = copy.deepcopy(_at(tree, draw.choice(places)))
    elif how < 0.69:
        table[key] = _deep(draw, draw.choice([3, 10, 40, 70]))
    else:
        table[key] = copy.deepcopy(draw.choice(ODD))


def _alike(value: Any, draw: random.Random) -> Any:
    """A value of the same kind, mostly."""
    if isinstance(value, int | float):
        power = 10.0 ** draw.choice([-150, -100, -30, -12, -8, -3, -1, 1, 3, 8, 12, 30, 100, 150])
        return draw.choice([-value, float(value) * power, 0, math.nan, str(value), [value]])
    if isinstance(value, str):
        letters = "".join(draw.choice("qvkbcVw sintahexplog0123.+-*/(),^") for _ in range(20))
        odd = f"{value}{draw.choice('+-*/()^=.é²≤')}"
        return draw.choice([odd, value[: len(value) // 2], value * 20, f"({value}", letters])
    if isinstance(value, list) and value:
        return draw.choice([value[:-1], [*value, value[-1]], [value], [], [*value, "a"], value * 3])
    return value


def _deep(draw: random.Random, depth: int) -> Any:
    value: Any = draw.choice([1.0, "a", {}])
    for _ in range(depth):
        value = [value] if draw.random() < 0.5 else {"a": value}
    return value


def mutated_text(text: str, draw: random.Random) -> str:
    """A text in which pieces are gone, new, swapped or there twice."""
    letters = list(text)
    for _ in range(draw.choice([1, 2, 4, 10])):
        if not letters:
            break
        k, how = draw.randrange(len(letters)), draw.random()
        if how < 0.3:
            del letters[k : k + draw.choice([1, 1, 3, 20, 200])]
        elif how < 0.7:
            letters[k:k] = draw.choice(PIECES)
        else:
            j = draw.randrange(len(letters))
            letters[k:k] = letters[j : j + draw.choice([1, 5, 40, 300])]
    return "".join(letters)


def mutated_bytes(content: bytes, draw: random.Random) -> bytes:
    """Bytes that are flipped, cut, doubled, moved, or numbers beyond what is there."""
    changed = bytearray(content)
    for _ in range(draw.choice([1, 1, 2, 4, 16])):
        if not changed:
            break
        # Heads say most; half of the changes are there.
        end = len(changed) if draw.random() < 0.5 else min(len(changed), 512)
        k, how = draw.randrange(end), draw.random()
        if how < 0.35:
            changed[k] ^= 1 << draw.randrange(8)
        elif how < 0.5:
            size = draw.choice([1, 2, 4, 8])
            number = draw.choice([0, 1, 255, 2**15, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1])
            changed[k : k + size] = (number % 256**size).to_bytes(size, "little")
        elif how < 0.65:
            del changed[k : k + draw.choice([1, 4, 64, 4096])]
        elif how < 0.75:
            del changed[k:]
        elif how < 0.9:
            j = draw.randrange(len(changed))
            changed[k:k] = changed[j : j + draw.choice([1, 8, 256])]
        else:
            changed[k : k + 8] = draw.randbytes(8)
    return bytes(changed)
