"""Arithmetic in LLVM's language that stays as it is written."""

import dataclasses
from collections.abc import Sequence

from backsight.engine.llvm._text import Text
from backsight.engine.llvm.width import Width

ROUND = 1.5 * 2.0**52
"""Added to a number, it leaves the nearest whole number in the lowest bits."""

MANTISSA = 52
"""Bits of a number behind the point."""

BIAS = 1023
"""What is added to the exponent of a number in its bits."""


@dataclasses.dataclass(frozen=True)
class Numbers:
    """Writes instructions without the freedoms of the leaves; returns the name of the value.

    Parameters
    ----------
    text : Text
        Where they are written.
    width : Width
    """

    text: Text
    width: Width

    def constant(self, value: float) -> str:
        """Write a number."""
        return self.width.constant(value)

    def add(self, a: str, b: str) -> str:
        """Write a + b."""
        return self._new("fadd", a, b)

    def sub(self, a: str, b: str) -> str:
        """Write a - b."""
        return self._new("fsub", a, b)

    def mul(self, a: str, b: str) -> str:
        """Write a b."""
        return self._new("fmul", a, b)

    def div(self, a: str, b: str) -> str:
        """Write a / b."""
        return self._new("fdiv", a, b)

    def neg(self, a: str) -> str:
        """Write -a."""
        return self._new("fneg", a)

    def fused(self, a: str, b: str, c: str) -> str:
        """Write a b + c, rounded once where the processor can."""
        return self.intrinsic("fmuladd", a, b, c)

    def exactly(self, a: str, b: str, c: str) -> str:
        """Write a b + c, always rounded once."""
        return self.intrinsic("fma", a, b, c)

    def intrinsic(self, name: str, *values: str) -> str:
        """Call an intrinsic function of LLVM."""
        kind = self.width.number
        arguments = ", ".join(f"{kind} {value}" for value in values)
        return self.text.new(f"call {kind} @llvm.{name}.{self.width.suffix}({arguments})")

    def when(self, test: str, a: str, b: str, then: str, otherwise: str) -> str:
        """Write `then` where the comparison of a and b holds."""
        return self.choose(self.compare(test, a, b), then, otherwise)

    def compare(self, test: str, a: str, b: str) -> str:
        """Write a condition; tests of LLVM that begin with o never hold for NaN."""
        return self._new(f"fcmp {test}", a, b)

    def choose(self, condition: str, then: str, otherwise: str) -> str:
        """Write `then` where the condition holds."""
        kind = self.width.number
        choice = f"{self.width.truth} {condition}, {kind} {then}, {kind} {otherwise}"
        return self.text.new(f"select {choice}")

    def bits(self, a: str) -> str:
        """Write a number as the whole number with the same bits."""
        return self.text.new(f"bitcast {self.width.number} {a} to {self.width.whole}")

    def of_bits(self, a: str) -> str:
        """Write the number with these bits."""
        return self.text.new(f"bitcast {self.width.whole} {a} to {self.width.number}")

    def on_bits(self, instruction: str, a: str, b: int) -> str:
        """Apply an instruction for whole numbers."""
        whole = self.width.whole
        return self.text.new(f"{instruction} {whole} {a}, {self.width.whole_constant(b)}")

    def everywhere(self, condition: str) -> str:
        """Write whether the condition holds in all lanes."""
        if self.width.lanes == 1:
            return condition
        kind = f"i{self.width.lanes}"
        together = self.text.new(f"bitcast {self.width.truth} {condition} to {kind}")
        return self.text.new(f"icmp eq {kind} {together}, -1")

    def nearest(self, a: str, factor: float) -> tuple[str, str]:
        """Whole number nearest to a times the factor, and a number with it as lowest bits."""
        shifted = self.fused(a, self.constant(factor), self.constant(ROUND))
        return self.sub(shifted, self.constant(ROUND)), shifted

    def power_of_two(self, whole: str) -> str:
        """Write 2 to a whole number between -1022 and 1023."""
        shifted = self.bits(self.add(whole, self.constant(ROUND + BIAS)))
        return self.of_bits(self.on_bits("shl", shifted, MANTISSA))

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """Evaluate in pairs (Estrin), so that much can be computed side by side."""
        terms, power = [self.constant(c) for c in coefficients], x
        while len(terms) > 1:
            pairs = [terms[i : i + 2] for i in range(0, len(terms), 2)]
            terms = [self.fused(p[1], power, p[0]) if len(p) == 2 else p[0] for p in pairs]
            if len(terms) > 1:
                power = self.mul(power, power)
        return terms[0]

    def _new(self, instruction: str, *values: str) -> str:
        return self.text.new(f"{instruction} {self.width.number} {', '.join(values)}")
