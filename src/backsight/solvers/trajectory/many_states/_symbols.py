"""One sample of a window of many states, in MX."""

from __future__ import annotations

import dataclasses

import casadi as ca

from backsight.engine.dense import all_entries, applied, few_entries
from backsight.solvers.trajectory.chain import Chain


@dataclasses.dataclass(frozen=True)
class SampleMatrices:
    """Description of a sample, see `Chain.inputs`, with its matrices."""

    symbols: list[ca.MX]
    F: ca.MX
    c: ca.MX
    before: ca.MX
    H: ca.MX
    e: ca.MX
    A: ca.MX

    @classmethod
    def of(cls, chain: Chain) -> SampleMatrices:
        """Symbols for a window's samples."""
        symbols = {k: ca.MX.sym(k, size) for k, size in chain.inputs.items()}
        return cls(
            symbols=[*symbols.values()],
            F=ca.MX(chain.F, symbols["F"]),
            c=symbols["c"],
            before=symbols["before"],
            H=ca.MX(chain.H, symbols["H"]),
            e=symbols["e"],
            A=all_entries(ca.MX(chain.A, symbols["A"])) if chain.n else ca.MX(0, chain.nx),
        )


def noise_along(chain: Chain, before: ca.MX, eta: ca.MX) -> ca.MX:
    """Noise (nx,) of the transition to a sample, of its adjoint eta."""
    parts = enumerate((chain.Q, *chain.parts))
    first, *rest = (before[k] * applied(few_entries(part), eta) for k, part in parts)
    return sum(rest, first)


def recorded(chain: Chain) -> dict[str, ca.MX]:
    """Symbols of what the forward pass keeps of a sample, see `Chain.records`."""
    return {k: ca.MX.sym(k, size) for k, size in chain.records.items()}
