"""What a sample has to report, by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import casadi as ca

from backsight.schema import Status

Raised = Any
"""Whether something happened: 0 or 1, or an expression of SX or MX."""


@dataclasses.dataclass(frozen=True)
class Flags:
    """What happened at a sample; every field, 0 or 1, is the bit of `Status` with its name.

    The order of the fields is that of the vector by which functions hand them on; nothing else
    knows it.
    """

    clipped: Raised = 0
    iteration_limit: Raised = 0
    step_rejected: Raised = 0
    not_positive_definite: Raised = 0
    not_excited: Raised = 0
    undefined: Raised = 0
    unobserved: Raised = 0
    infeasible: Raised = 0
    dependent: Raised = 0
    coarse_step: Raised = 0
    not_solved: Raised = 0
    redundant: Raised = 0
    not_optimal: Raised = 0
    gate_open: Raised = 0  # raised around the method, see `backsight.estimators.around.robust`
    turn_guessed: Raised = 0  # the same, see `backsight.estimators.around.turns`
    misled: Raised = 0  # the same, see `backsight.estimators.around.misled`

    @classmethod
    def of(cls, vector: Raised) -> Flags:
        """Give the entries of a `vector` their names again."""
        entries: Sequence[Raised] = ca.vertsplit(vector)
        return cls(*entries)

    def vector(self) -> Raised:
        """All flags on top of each other, (`FLAGS`,)."""
        return ca.vertcat(*(getattr(self, f.name) for f in dataclasses.fields(self)))

    def status(self) -> Raised:
        """Sum of the bits of `Status`."""
        bits = [int(Status[f.name.upper()]) for f in dataclasses.fields(self)]
        return ca.dot(self.vector(), ca.DM(bits))


FLAGS = len(dataclasses.fields(Flags))
"""Length of `Flags.vector`."""


def raised_in_either(a: Raised, b: Raised) -> Raised:
    """Vector of the flags that are raised in one of two vectors of flags."""
    return ca.fmax(a, b)
