"""Equations as the user writes them: ``w' = (kt*i - load) / J``, ``speed = w``."""

import dataclasses
import re
from collections.abc import Collection, Mapping

from backsight.algebra.expressions import CONSTANTS, FUNCTIONS
from backsight.errors import ProblemError, printable

EXAMPLE = "w' = (kt*i - b*w - load) / J\nspeed = w\n"

_LINE = re.compile(r"([^\W\d]\w*)\s*('?)\s*=(?!=)\s*(.+)")
_NAME = re.compile(r"(?<![\w.])[^\W\d]\w*")


@dataclasses.dataclass(frozen=True)
class Equations:
    """Equations of a model.

    Parameters
    ----------
    rates : dict
        State to the formula of its rate.
    outputs : dict
        Output to its formula.
    """

    rates: Mapping[str, str]
    outputs: Mapping[str, str]

    def constants(self, inputs: Collection[str]) -> list[str]:
        """Names that are neither states nor inputs, in the order in which they come."""
        formulas = [*self.rates.values(), *self.outputs.values()]
        names = [name for formula in formulas for name in _NAME.findall(formula)]
        known = {*self.rates, *inputs, *FUNCTIONS, *CONSTANTS}
        return [name for name in dict.fromkeys(names) if name not in known]

    def units(self, outputs: Mapping[str, str]) -> dict[str, str]:
        """Units of the states, as far as those of the outputs tell.

        An output that is a state has its unit; what is the rate of a state, its unit per second.
        """
        found = dict.fromkeys(self.rates, "")
        found |= {f: outputs[n] for n, f in self.outputs.items() if f in found and outputs.get(n)}
        for name, formula in self.rates.items():
            if found.get(formula) == "" and found[name]:
                found[formula] = f"{found[name]}/s"
        return found


def read_equations(text: str) -> Equations:
    """Read a text with an equation a line; what follows ``#`` is a comment.

    Raises
    ------
    ProblemError
        With the line that is no equation, or whose name is there twice. What is wrong inside a
        formula is said when the model is built.
    """
    rates: dict[str, str] = {}
    outputs: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        bare = line.partition("#")[0].strip()
        if not bare:
            continue
        match = _LINE.fullmatch(bare)
        if match is None:
            raise ProblemError(
                f"equations, line {number}: '{printable(bare)[:40]}' is not \"state' = formula\" "
                'or "output = formula"'
            )
        name, prime, formula = match.groups()
        group = rates if prime else outputs
        if name in group:
            raise ProblemError(f"equations, line {number}: '{name}' has an equation already")
        group[name] = formula.strip()
    if not rates:
        raise ProblemError("equations: there is no state yet; write its rate as v' = -k*q")
    return Equations(rates, outputs)
