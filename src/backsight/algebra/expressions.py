"""Formulas as text, read into CasADi expressions; nothing of the text is ever executed as code."""

import math
import operator
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple, final

import casadi as ca

from backsight.algebra._limits import hypotenuse, quotient, root_of
from backsight.errors import ModelError, nearest

MAX_LENGTH = 10_000
"""Longest formula that is read [characters]."""

MAX_DEPTH = 60
"""Deepest nesting of brackets, signs and powers that is read."""

FUNCTIONS = {
    "sin": (1, ca.sin),
    "cos": (1, ca.cos),
    "tan": (1, ca.tan),
    "asin": (1, ca.asin),
    "acos": (1, ca.acos),
    "atan": (1, ca.atan),
    "atan2": (2, ca.atan2),
    "sinh": (1, ca.sinh),
    "cosh": (1, ca.cosh),
    "tanh": (1, ca.tanh),
    "exp": (1, ca.exp),
    "log": (1, ca.log),
    "log10": (1, ca.log10),
    "sqrt": (1, root_of),
    "abs": (1, ca.fabs),
    "sign": (1, ca.sign),
    "min": (2, ca.fmin),
    "max": (2, ca.fmax),
    "hypot": (2, hypotenuse),
}
"""Functions that a formula may use: number of arguments and meaning. ``log`` is the natural one."""

CONSTANTS = {"pi": math.pi}
"""Numbers that a formula may name."""

_BINARY = {
    "+": (1, operator.add),
    "-": (1, operator.sub),
    "*": (2, operator.mul),
    "/": (2, quotient),
    "**": (4, operator.pow),
}
_SIGN_LEVEL = 3  # a sign binds less than a power and more than a product: -x**2 is -(x**2)

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[^\W\d]\w*)"
    r"|(?P<mark>\*\*|[-+*/(),])"
    r"|(?P<foreign>\S)"
)

_ADVICE = {
    "^": "write ** for a power",
    "=": "write the right side of the equation only",
    ".": "write the plain name, 'v' and not 'x.v'",
    "'": "give the derivative a name of its own, for example v for the rate of q",
    "·": "write * for a product",
    "×": "write * for a product",
    "−": "write - for a minus",
}


class _Token(NamedTuple):
    kind: str
    text: str
    column: int


def expression(text: object, symbols: Mapping[str, ca.SX], *, where: str) -> ca.SX:
    """Read one formula.

    The grammar is that of Python's arithmetic: ``+ - * / **``, brackets, numbers, the `FUNCTIONS`,
    the `CONSTANTS` and the names in `symbols`. Line breaks count as blanks.

    Parameters
    ----------
    text : str
        The formula, at most `MAX_LENGTH` characters and nested at most `MAX_DEPTH` deep.
    symbols : dict
        Name to scalar expression.
    where : str
        What the formula belongs to, for the error message.

    Returns
    -------
    casadi.SX
        Scalar expression of the symbols.

    Raises
    ------
    ModelError
        With `where`, the column (from 1) and the reason, if the text is anything else, or a
        constant part of it has no finite value.
    """
    if not isinstance(text, str):
        raise ModelError(f"{where} is {text!r}; write it as text")
    if len(text) > MAX_LENGTH:
        raise ModelError(f"{where} has {len(text)} characters; the limit is {MAX_LENGTH}")
    return _Parser(text, symbols, where).whole()


def expressions(texts: Mapping[str, object], symbols: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Read many formulas, each under the name of its place.

    Raises
    ------
    ModelError
        With all that is wrong in all of them.
    """
    read, problems = {}, []
    for where, text in texts.items():
        try:
            read[where] = expression(text, symbols, where=where)
        except ModelError as error:
            problems.append(str(error))
    if problems:
        raise ModelError("; ".join(problems))
    return read


def check_names(names: Iterable[str]) -> None:
    """Raise `ModelError` if a signal has the name of a function or constant of the formulas."""
    for name in names:
        if name in FUNCTIONS or name in CONSTANTS:
            kind = "function" if name in FUNCTIONS else "constant"
            raise ModelError(f"'{name}' is a {kind} in formulas; give the signal another name")


@final
class _Parser:
    """Reads by precedence climbing; recursion is bounded by `MAX_DEPTH`."""

    def __init__(self, text: str, symbols: Mapping[str, ca.SX], where: str) -> None:
        self._where = where
        self._symbols = symbols
        self._tokens = [
            _Token(str(m.lastgroup), m.group(), m.start() + 1) for m in _TOKEN.finditer(text)
        ]
        self._tokens.append(_Token("end", "", len(text) + 1))
        self._position = 0

    @property
    def _here(self) -> _Token:
        return self._tokens[self._position]

    def whole(self) -> ca.SX:
        value = self._climb(1, 0)
        self._expect("", "a bracket is closed, or a comma set, where none is open")
        return value

    def _climb(self, level: int, depth: int) -> ca.SX:
        if depth > MAX_DEPTH:
            raise self._error(self._here, f"nested more than {MAX_DEPTH} deep")
        value = self._operand(depth)
        while True:
            token = self._here
            own, apply = _BINARY.get(token.text, (0, None))
            if apply is None or own < level:
                return value
            self._position += 1
            # Powers group from the right, and their exponent may carry a sign: 2**-x**2.
            right = self._climb(_SIGN_LEVEL if token.text == "**" else own + 1, depth + 1)
            if token.text == "/" and right.is_zero():
                raise self._error(token, "division by zero")
            value = self._finite(token, apply(value, right))

    def _operand(self, depth: int) -> ca.SX:
        token = self._here
        self._position += 1
        if token.kind == "number":
            return self._finite(token, ca.SX(float(token.text)))
        if token.kind == "name":
            if self._here.text == "(":
                return self._call(token, depth)
            return self._symbol(token)
        if token.text in ("+", "-"):
            value = self._climb(_SIGN_LEVEL, depth + 1)
            return -value if token.text == "-" else value
        if token.text == "(":
            value = self._climb(1, depth + 1)
            self._expect(")", f"the bracket opened at column {token.column} is not closed")
            return value
        if token.kind == "foreign":
            raise self._foreign(token)
        found = "the formula ends" if token.kind == "end" else f"{_quoted(token)} stands"
        raise self._error(token, f"{found} where a number, a name or a bracket is needed")

    def _symbol(self, token: _Token) -> ca.SX:
        if token.text in self._symbols:
            return self._symbols[token.text]
        if token.text in CONSTANTS:
            return ca.SX(CONSTANTS[token.text])
        if token.text in FUNCTIONS:
            raise self._error(token, f"the function {token.text} needs its arguments in brackets")
        if self._here.text == ".":
            raise self._foreign(self._here)
        raise self._error(
            token, f"unknown name {_quoted(token)}: {nearest(token.text, self._symbols)}"
        )

    def _call(self, token: _Token, depth: int) -> ca.SX:
        if token.text in self._symbols or token.text in CONSTANTS:
            raise self._error(token, f"{_quoted(token)} is not a function; write * for a product")
        if token.text not in FUNCTIONS:
            raise self._error(
                token, f"unknown function {_quoted(token)}: {nearest(token.text, FUNCTIONS)}"
            )
        count, apply = FUNCTIONS[token.text]
        self._position += 1
        arguments = [self._climb(1, depth + 1)]
        while self._here.text == ",":
            self._position += 1
            arguments.append(self._climb(1, depth + 1))
        self._expect(")", f"the bracket of {token.text} is not closed")
        if len(arguments) != count:
            raise self._error(
                token, f"{token.text} needs {count} argument(s), not {len(arguments)}"
            )
        return self._finite(token, apply(*arguments))

    def _expect(self, mark: str, reason: str) -> None:
        token = self._here
        if token.text == mark:
            self._position += 1
        elif token.kind in ("number", "name") or token.text == "(":
            raise self._error(
                token, f"an operator is missing before {_quoted(token)}; * is a product"
            )
        elif token.kind == "foreign":
            raise self._foreign(token)
        else:
            raise self._error(token, reason)

    def _finite(self, token: _Token, value: ca.SX) -> ca.SX:
        if value.is_constant() and not math.isfinite(float(value)):
            raise self._error(
                token, f"{_quoted(token)} gives {float(value)}, which is not a finite number"
            )
        return value

    def _foreign(self, token: _Token) -> ModelError:
        advice = _ADVICE.get(token.text)
        return self._error(
            token, f"{_quoted(token)} is not allowed{f': {advice}' if advice else ''}"
        )

    def _error(self, token: _Token, reason: str) -> ModelError:
        return ModelError(f"{self._where}, column {token.column}: {reason}")


def _quoted(token: _Token) -> str:
    text = token.text if len(token.text) <= 30 else f"{token.text[:30]}…"
    return f"'{text}'" if text.isprintable() else ascii(text)
