"""Formulas as text: Python's own parser is the oracle for the meaning, garbage for the refusals."""

import math
import re

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.algebra.expressions import (
    CONSTANTS,
    FUNCTIONS,
    MAX_DEPTH,
    MAX_LENGTH,
    expression,
    expressions,
)
from backsight.errors import ModelError

X = {name: ca.SX.sym(name) for name in ("x", "y", "v_max")}
POINTS = np.array([[0.3, -1.7, 2.0], [-2.5, 0.4, 1e3], [1.0, 1.0, 0.0]])
ADJACENT = re.compile(r"(?<![\w.])(\d+\.?\d*(?:e-?\d+)?)")


def read(text: str) -> ca.SX:
    return expression(text, X, where="equation 'v'")


def numbers(formula: ca.SX) -> np.ndarray:
    evaluate = ca.Function("formula", list(X.values()), [formula])
    return np.array([float(evaluate(*point)) for point in POINTS])


def value(text: str, *, x: float = 0.3, y: float = -1.7) -> float:
    return float(ca.Function("formula", [X["x"], X["y"]], [read(text)])(x, y))


def formulas(children: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    one = st.sampled_from([n for n, (count, _) in FUNCTIONS.items() if count == 1])
    two = st.sampled_from([n for n, (count, _) in FUNCTIONS.items() if count == 2])
    blank = st.sampled_from(["", " ", "\n"])
    return st.one_of(
        st.builds("{}{}{}{}{}".format, children, blank, st.sampled_from("+-*/"), blank, children),
        st.builds("{}**{}".format, children, children),
        st.builds("({})".format, children),
        st.builds("-{}".format, children),
        st.builds("+{}".format, children),
        st.builds("{}({})".format, one, children),
        st.builds("{}({}, {})".format, two, children, children),
    )


ATOMS = st.sampled_from(["x", "y", "v_max", "pi", "0", "1", "2", "0.5", "3.", "1e-3", "12e2"])
FORMULAS = st.recursive(ATOMS, formulas, max_leaves=12)


@given(FORMULAS)
@settings(max_examples=300, deadline=None, derandomize=True)
def test_formula_means_what_python_arithmetic_means(text: str) -> None:
    # The oracle reads the text with Python's parser and calculates with the same CasADi numbers,
    # so that the two must agree to the last bit.
    names = X | CONSTANTS | {n: apply for n, (_, apply) in FUNCTIONS.items()} | {"N": ca.SX}
    names["pi"] = ca.SX(math.pi)
    joined = ADJACENT.sub(r"N(\1)", text.replace("\n", " "))
    ours, message = None, ""
    try:
        ours = read(text)
    except ModelError as error:
        message = str(error)
    if ours is None:
        assert re.search("not a finite number|division by zero", message)
        return
    theirs = ca.SX(eval(joined, {"__builtins__": {}}, names))
    np.testing.assert_array_equal(numbers(ours), numbers(theirs))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-x**2", -(0.3**2)),
        ("2**-x", 2**-0.3),
        ("2**3**2", 512.0),
        ("8/4/2", 1.0),
        ("1 - 2 - 3", -4.0),
        ("--x", 0.3),
        ("2*-y**2", -2 * 1.7**2),
        ("min(x, y) + max(x, y)", 0.3 - 1.7),
        ("hypot(x, y)", math.hypot(0.3, -1.7)),
        ("atan2(y, x)", math.atan2(-1.7, 0.3)),
        ("abs(y) * sign(y)", -1.7),
        ("log10(100) + log(exp(x))", 2.3),
        ("sin(pi/6)", 0.5),
        ("asin(x)+acos(x)", math.pi / 2),
        ("sinh(x)/cosh(x) - tanh(x)", 0.0),
        ("tan(atan(x))", 0.3),
        ("sqrt(.09)", 0.3),
        ("1.5e+1", 15.0),
        ("x\n + y", -1.4),
    ],
)
def test_values(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("x^2", 2, "write ** for a power"),
        ("2x", 2, "operator is missing before 'x'"),
        ("x y", 3, "operator is missing before 'y'"),
        ("(x) (y)", 5, "operator is missing before '('"),
        ("vmax + 1", 1, "did you mean 'v_max'?"),
        ("z", 1, "known: v_max, x, y"),
        ("tanhh(x)", 1, "did you mean 'tanh'?"),
        ("__import__('os')", 1, "unknown function '__import__'"),
        ("x.real", 2, "plain name"),
        ("s.x", 2, "plain name"),
        ("x(2)", 1, "not a function"),
        ("2 * sin", 5, "needs its arguments in brackets"),
        ("sin(x, y)", 1, "needs 1 argument(s), not 2"),
        ("1 + max(x)", 5, "needs 2 argument(s), not 1"),
        ("sin()", 5, "')' stands where"),
        ("(x + y", 7, "opened at column 1 is not closed"),
        ("max(x, y", 9, "bracket of max is not closed"),
        ("x + y)", 6, "where none is open"),
        ("x, y", 2, "where none is open"),
        ("x +", 4, "formula ends"),
        ("", 1, "formula ends"),
        ("* x", 1, "'*' stands where"),
        ("x // y", 4, "'/' stands where"),
        ("x = y", 3, "right side"),
        ("x < y", 3, "'<' is not allowed"),
        ("x − y", 3, "write - for a minus"),
        ("x'", 2, "name of its own"),
        ("lambda: x", 1, "unknown name 'lambda'"),
        ("1e999", 1, "not a finite number"),
        ("9" * 400, 1, "not a finite number"),
        ("9**9**9**9", 5, "not a finite number"),
        ("x + 1/(2 - 2)", 6, "division by zero"),
        ("x/0", 2, "division by zero"),
        ("sqrt(-1)", 1, "not a finite number"),
        ("x\n + z", 6, "unknown name 'z'"),
        ("x\x00", 2, "'\\x00' is not allowed"),
    ],
)
def test_refusal_names_place_and_reason(text: str, column: int, reason: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(text)
    message = str(caught.value)
    assert message.startswith(f"equation 'v', column {column}: ")
    assert reason in message
    assert "\n" not in message


@given(st.one_of(st.text(max_size=60), st.text("xyv_0123456789.eE+-*/(), ^=", max_size=60)))
@settings(max_examples=300, deadline=None, derandomize=True)
def test_garbage_raises_nothing_but_model_error(text: str) -> None:
    message = ""
    try:
        read(text)
    except ModelError as error:
        message = str(error)
    assert "\n" not in message


@pytest.mark.parametrize(
    "text",
    [
        "(" * MAX_LENGTH,
        "-" * MAX_LENGTH,
        "sin(" * (MAX_LENGTH // 4),
        "x**" * (MAX_LENGTH // 3) + "x",
        "(" * (MAX_DEPTH + 1) + "x" + ")" * (MAX_DEPTH + 1),
        "x" * MAX_LENGTH,
        "1" * MAX_LENGTH,
        "9**" * 50 + "9",
        "x" * (MAX_LENGTH + 1),
    ],
)
def test_absurd_input_is_refused(text: str) -> None:
    with pytest.raises(ModelError):
        read(text)


def test_long_and_deep_formulas_within_the_limits_are_read() -> None:
    assert value("x+" * 4999 + "x") == pytest.approx(5000 * 0.3)
    assert value("(" * MAX_DEPTH + "x" + ")" * MAX_DEPTH) == 0.3
    assert math.isinf(value("x**-1e300"))


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(ModelError, match=r"first, column 1: .*; second, column 2: "):
        expressions({"first": "a", "good": "x", "second": "x^2"}, X)


@pytest.mark.parametrize("given_value", [3, None, ["x"]])
def test_text_is_required(given_value: object) -> None:
    with pytest.raises(ModelError, match="write it as text"):
        expression(given_value, X, where="equation 'v'")
