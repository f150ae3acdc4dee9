"""Equations of a problem file: letters, words and operators in any order."""

import random

from tests.fuzz.isolated import Area
from tests.fuzz.mutating import mutated_text

import backsight as bs

WORDS = ["q", "v", "u", "k", "b", "pi", "sin", "exp", "log", "sqrt", "abs", "max", "min", "sign",
         "tanh", "where", "delay", "(", ")", "(", ")", "+", "-", "*", "/", "^", "**", ",", "<", ">",
         "==", "1", "2.5", "1e999", "0", ".", "and", "if", "é", "²", "'", "[", ";"]  # fmt: skip

RIGHT = ["u - k*q - b*v", "u - k*q^3 - b*tanh(v/0.01)", "-k*sin(q) + max(u, 0)", "sqrt(abs(q)) - v"]


def area() -> Area:
    """The right side of an equation."""

    def make(draw: random.Random) -> bytes:
        if draw.random() < 0.5:
            return mutated_text(draw.choice(RIGHT), draw).encode("utf-8", "surrogatepass")
        return " ".join(draw.choice(WORDS) for _ in range(draw.randint(1, 25))).encode()

    def attempt(case: bytes) -> None:
        bs.from_equations(
            states={"q": "m", "v": "m/s"},
            inputs={"u": "N"},
            outputs={"y": "m"},
            equations={"q": "v", "v": case.decode("utf-8", "replace")},
            output_equations={"y": "q"},
            parameters={"k": 1.0, "b": 0.1},
        )

    return Area("expressions", make, attempt)
