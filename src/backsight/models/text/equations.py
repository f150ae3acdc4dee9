"""Models from equations written as text."""

from collections.abc import Mapping

import casadi as ca

from backsight.algebra.expressions import check_names, expressions
from backsight.algebra.newton import Root, newton
from backsight.errors import ModelError, nearest
from backsight.models.implicit import check_determined
from backsight.models.model import Model, Signals
from backsight.models.signals import Named, signals


def from_equations(
    *,
    states: Signals,
    outputs: Signals,
    equations: Mapping[str, str],
    output_equations: Mapping[str, str],
    inputs: Signals = (),
    parameters: Signals = (),
    algebraic: Signals = (),
    constraints: Mapping[str, str] | None = None,
    guesses: Mapping[str, str] | None = None,
    dt: float | None = None,
    name: str = "model",
) -> Model:
    r"""Build a model from equations written as text, as a problem file holds them.

    The text is read by a parser for arithmetic (see `backsight.algebra.expressions`); it is never
    executed.

    Parameters
    ----------
    states, outputs, inputs, parameters : dict
        Name to unit, value, ``(value, unit)`` or `Signal`, in order.
    equations : dict
        State to the formula of its time derivative; of its next value if `dt` is given.
        The formula uses the names of the states, inputs and parameters.
    output_equations : dict
        Output to its formula.
    algebraic : dict, optional
        Variables without a rate of their own, such as the place of a node without mass; equations
        and outputs may use them. They are solved for, see `backsight.models.implicit`.
    constraints : dict, optional
        Formulas that are zero, by any names; as many as algebraic variables.
    guesses : dict, optional
        Algebraic variable to a formula from which its solution starts; the others start from their
        values.
    dt : float, optional
        Sampling period of a discrete-time model [s].
    name : str
        Shown in results.

    Raises
    ------
    ModelError
        If a formula is not arithmetic or uses an undeclared name (with its column and the nearest
        name), if an equation is missing or surplus, or if the signals are described wrongly.

    Examples
    --------
    >>> drive = from_equations(
    ...     states={"q": "m", "v": "m/s"},
    ...     inputs={"F": "N"},
    ...     outputs={"y": "m"},
    ...     parameters={"M": (95.0, "kg"), "Fv": 200.0, "Fc": 20.0, "vs": 1e-3},
    ...     equations={"q": "v", "v": "(F - Fv*v - Fc*tanh(v/vs)) / M"},
    ...     output_equations={"y": "q"},
    ... )
    >>> drive.f([0, 0], 190, drive.theta)
    DM([0, 2])
    """
    groups = (
        signals(states, "state"),
        signals(inputs, "input"),
        signals(parameters, "parameter"),
    )
    of_z = signals(algebraic, "algebraic variable")
    check_names(s.name for group in (*groups, of_z) for s in group)
    zero = {f"constraint '{n}'": text for n, text in (constraints or {}).items()}
    begin = {f"guess of '{n}'": text for n, text in (guesses or {}).items()}
    for key in guesses or {}:
        if key not in {s.name for s in of_z}:
            known = [s.name for s in of_z]
            raise ModelError(f"model '{name}': guesses names '{key}', {nearest(key, known)}")
    of_states = {f"equation '{n}'": text for n, text in equations.items()}
    of_outputs = {f"output equation '{n}'": text for n, text in output_equations.items()}

    def plain(vectors: tuple[Named, ...]) -> dict[str, ca.SX]:
        return {s.name: v[s.name] for v, group in zip(vectors, groups, strict=True) for s in group}

    def root(known: dict[str, ca.SX]) -> Root:
        """Algebraic variables."""
        called = [f"'{s.name}'" for s in of_z]

        def equations(w: ca.SX) -> ca.SX:
            there = {s.name: w[i] for i, s in enumerate(of_z)}
            return ca.vertcat(*expressions(zero, known | there).values())

        check_determined(equations, called, f"model '{name}': constraints")
        read = expressions(begin, known)
        start = [read.get(f"guess of '{s.name}'", ca.SX(s.value)) for s in of_z]
        return newton(equations, ca.vertcat(*start))

    def symbols(vectors: tuple[Named, ...]) -> dict[str, ca.SX]:
        known = plain(vectors)
        if not (of_z or zero):
            return known
        w = root(known).w
        return known | {s.name: w[i] for i, s in enumerate(of_z)}

    def unsolved() -> ca.Function | None:
        if not of_z:
            return None
        vectors = [ca.SX.sym(k, len(group)) for k, group in zip("xup", groups, strict=True)]
        named = tuple(
            Named("", [s.name for s in group], v) for group, v in zip(groups, vectors, strict=True)
        )
        return ca.Function("unsolved", vectors, [root(plain(named)).left])

    def f(*xup: Named) -> dict[str, ca.SX]:
        # The output equations are read here too, so that all faults are told at once.
        read = expressions(of_states | of_outputs, symbols(xup))
        return {n: read[where] for n, where in zip(equations, of_states, strict=True)}

    def h(*xup: Named) -> dict[str, ca.SX]:
        read = expressions(of_outputs, symbols(xup))
        return {n: read[where] for n, where in zip(output_equations, of_outputs, strict=True)}

    return Model(
        f=f,
        h=h,
        states=groups[0],
        inputs=groups[1],
        outputs=outputs,
        parameters=groups[2],
        dt=dt,
        name=name,
        unsolved=unsolved(),
    )
