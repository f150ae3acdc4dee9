"""What functions of the user return, as rows of expressions."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from backsight.errors import ModelError, nearest
from backsight.models.signals import Signal


def rows_of_function(given: ca.Function, arguments: list[ca.SX], where: str) -> list[ca.SX]:
    """Rows of a function of CasADi, unless it calls a solver."""
    inside = [given, *given.find_functions()]
    solvers = [k for k in inside if k.class_name() not in ("SXFunction", "MXFunction")]
    if solvers:
        raise ModelError(
            f"{where} calls '{solvers[0].name()}', a {solvers[0].class_name()} of CasADi, which is "
            "no expression; describe equations that must be solved by bs.models.implicit, which "
            "does so in every engine"
        )
    return given.call(arguments)


def returned_rows(returned: Any, of: tuple[Signal, ...], where: str) -> list[ca.SX]:
    """Rows of what a function of the user returned, in order."""
    if isinstance(returned, Mapping):
        names = [s.name for s in of]
        for name in returned:
            if name not in names:
                raise ModelError(f"{where} has an entry '{name}': {nearest(name, names)}")
        missing = [n for n in names if n not in returned]
        if missing:
            raise ModelError(f"{where} has no entry for {', '.join(missing)}")
        returned = [returned[n] for n in names]
    rows = returned if isinstance(returned, list | tuple) else [returned]
    try:
        return [ca.SX(row) for row in rows]
    except NotImplementedError:
        hint = ""
        if any(isinstance(row, ca.MX) for row in rows):
            hint = (
                ": a CasADi function such as a rootfinder gives MX, which is none here; describe "
                "equations that must be solved by bs.models.implicit"
            )
        raise ModelError(
            f"{where} returns something that is not a number or expression{hint}"
        ) from None
