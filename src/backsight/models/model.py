"""The model: named signals, state equation and output equation."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.description import Positive, equations_of, fault, preformatted, tree
from backsight.errors import ModelError, nearest
from backsight.models._affine import by_parameters, remember, remembered
from backsight.models._latex import latex
from backsight.models._tracing import returned_rows, rows_of_function
from backsight.models.forces.driven import Driven
from backsight.models.signals import Named, Signal, Virtual, signals, traced
from backsight.types import Array

Equations = Callable[..., object] | ca.Function
"""``(x, u, p)`` to a list or dict of expressions."""

Signals = Mapping[str, object] | Sequence[Signal]
"""Name to unit, value, ``(value, unit)`` or `Signal`; or signals that have their names."""


@dataclasses.dataclass(frozen=True, init=False)
class Model:
    r"""A dynamic system :math:`\dot x = f(x, u, p),\; y = h(x, u, p)`, or :math:`x^+ = f(x, u, p)`.

    Parameters
    ----------
    f, h : callable (x, u, p) -> list or dict of expressions, or casadi.Function
        State equation and output equation. The arguments give access by name: ``x.v``, ``u.V``,
        ``p.k``; the result is a list in the order of the states (outputs) or a dict by name.
        Ordinary arithmetic and the functions of `casadi` (``ca.tanh``...) or NumPy (``np.tanh``...)
        may be used.
    states, inputs, outputs, parameters : dict
        Name to unit, value, ``(value, unit)`` or `Signal`, in order.
    dt : float, optional
        Sampling period of a discrete-time model [s]; None for a continuous-time model.
    name : str
        Shown in results.
    unsolved : casadi.Function, optional
        ``(x, u, p)`` to what equations that are solved inside f and h leave, see
        `backsight.algebra.newton.Root`; set by `backsight.models.implicit`.
    driven : tuple of Driven
        States with a noise of their own, see `augment`. Noise and prior of every estimator count
        it in.
    virtual : Virtual, optional
        Quantities that no sensor measures, made by `with_virtual`.

    Raises
    ------
    ModelError
        If a name is used twice or unknown, or an equation has the wrong size or is not finite.

    Examples
    --------
    >>> stage = Model(
    ...     f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
    ...     h=lambda x, u, p: [x.q],
    ...     states={"q": "um", "v": "um/s"}, inputs={"V": "V"}, outputs={"y": "um"},
    ...     parameters={"k": 7e6, "b": 77.0, "c": 5.4e5},
    ... )
    >>> print(stage)
    model (continuous)
    ├── states      q [um], v [um/s]
    ├── inputs      V [V]
    ├── outputs     y [um]
    └── parameters  k = 7e+06, b = 77, c = 540000
    """

    f: ca.Function
    h: ca.Function
    states: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    parameters: tuple[Signal, ...]
    dt: float | None
    name: str
    driven: tuple[Driven, ...]
    unsolved: ca.Function | None
    virtual: Virtual | None

    def __init__(
        self,
        f: Equations,
        h: Equations,
        *,
        states: Signals,
        outputs: Signals,
        inputs: Signals = (),
        parameters: Signals = (),
        dt: float | None = None,
        name: str = "model",
        driven: tuple[Driven, ...] = (),
        unsolved: ca.Function | None = None,
        virtual: Virtual | None = None,
    ) -> None:
        fields = {
            "states": signals(states, "state"),
            "inputs": signals(inputs, "input"),
            "outputs": signals(outputs, "output"),
            "parameters": signals(parameters, "parameter"),
            "dt": dt,
            "name": name,
            "driven": driven,
            "unsolved": unsolved,
            "virtual": virtual,
        }
        for field, value in fields.items():
            object.__setattr__(self, field, value)
        self._check()
        object.__setattr__(self, "f", self._trace(f, "f", self.states))
        object.__setattr__(self, "h", self._trace(h, "h", self.outputs))

    def _check(self) -> None:
        problems = [
            f"'{s.name}' is not a name: use letters, digits and underscores"
            for s in self.signals
            if not s.name.isidentifier()
        ]
        problems += [
            f"the name '{name}' is used twice"
            for name, count in Counter(s.name for s in self.signals).items()
            if count > 1 and name not in {s.name for s in self.outputs}
        ]
        problems += self._faults_of_virtual()
        if not self.states:
            problems.append("a model needs at least one state")
        if not self.outputs:
            problems.append("a model needs at least one output")
        if self.dt is not None:
            problems.append(fault(Positive, self.dt, "the sampling period dt") or "")
        problems.append(fault(str, self.name, "the name") or "")
        known = {s.name for s in self.states}
        problems += [
            f"'{name}' has a noise of its own, but is no state"
            for group in self.driven
            for name in group.states
            if name not in known
        ]
        problems = [p for p in problems if p]
        if problems:
            raise ModelError(f"model '{self.name}': " + "; ".join(problems))

    def _faults_of_virtual(self) -> list[str]:
        if self.virtual is None:
            return []
        names = [s.name for s in self.virtual.signals]
        taken = {s.name for s in self.signals}
        problems = [
            f"'{n}' is not a name: use letters, digits and underscores"
            for n in names
            if not n.isidentifier()
        ]
        problems += [
            f"the virtual output '{n}' has the name of another signal"
            for i, n in enumerate(names)
            if n in taken or n in names[:i]
        ]
        sizes = [self.virtual.g.numel_in(i) for i in range(3)]
        if sizes != [self.nx, self.nu, len(self.parameters)]:
            problems.append("its virtual outputs are those of a model with other signals")
        return problems

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All signals: states, inputs, outputs, parameters."""
        return (*self.states, *self.inputs, *self.outputs, *self.parameters)

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return len(self.outputs)

    @property
    def continuous(self) -> bool:
        """Whether `f` is a time derivative."""
        return self.dt is None

    @property
    def resting(self) -> tuple[str, ...]:
        """Names of the states that the model leaves as they are: unknown constants, walks."""
        x = ca.SX.sym("x", self.nx)
        rate = self.rhs(x, ca.SX.sym("u", self.nu))
        still = rate if self.continuous else rate - x
        rows = zip(self.states, ca.vertsplit(still), strict=True)
        return tuple(s.name for s, row in rows if row.is_zero())

    @property
    def theta(self) -> Array:
        """Values of the parameters, (np,)."""
        return np.array([s.value for s in self.parameters])

    def rhs(self, x: ca.SX, u: ca.SX) -> ca.SX:
        """State equation with the parameters at their values."""
        return self.f.call([x, u, ca.SX(self.theta)])[0]

    def output(self, x: ca.SX, u: ca.SX) -> ca.SX:
        """Output equation with the parameters at their values."""
        return self.h.call([x, u, ca.SX(self.theta)])[0]

    def unsolved_at(self, symbols: list[ca.SX], given: list[ca.SX]) -> ca.Function | None:
        """`unsolved` as a function of the symbols of another model, of which `given` are made."""
        if self.unsolved is None:
            return None
        return ca.Function("unsolved", symbols, self.unsolved.call(given))

    def noise_of_its_own(self) -> Array:
        """Noise of the `driven` states among all, (nx, nx): a density, or per sample."""
        whole = np.zeros((self.nx, self.nx))
        for group in self.driven:
            at = [self.index(name) for name in group.states]
            whole[np.ix_(at, at)] = group.noise
        return whole

    def index(self, state: str) -> int:
        """Position of a state; raises `ModelError` if there is none of that name."""
        names = [s.name for s in self.states]
        if state not in names:
            raise ModelError(f"the model has no state '{state}': {nearest(state, names)}")
        return names.index(state)

    def __str__(self) -> str:
        kind = "continuous" if self.continuous else f"discrete, dt = {self.dt:g} s"
        rows = [
            ("states", ", ".join(map(_label, self.states))),
            ("inputs", ", ".join(map(_label, self.inputs))),
            ("outputs", ", ".join(map(_label, self.outputs))),
            ("parameters", ", ".join(f"{s.name} = {s.value:g}" for s in self.parameters)),
            ("driven", "; ".join(group.says for group in self.driven)),
            ("virtual", ", ".join(map(_label, self.virtual.signals if self.virtual else ()))),
        ]
        return tree(f"{self.name} ({kind})", [row for row in rows if row[1]])

    def _repr_html_(self) -> str:
        return preformatted(str(self)) + equations_of(latex(self))

    def _trace(self, given: Equations, name: str, of: tuple[Signal, ...]) -> ca.Function:
        x, u, p = (
            ca.SX.sym(n, len(s))
            for n, s in (("x", self.states), ("u", self.inputs), ("p", self.parameters))
        )
        what = {"f": "state equation f", "h": "output equation h"}[name]
        where = f"model '{self.name}': {what}"
        if isinstance(given, ca.Function):
            rows = rows_of_function(given, [x, u, p], where)
        else:
            returned = traced(
                given,
                Named("state", [s.name for s in self.states], x),
                Named("input", [s.name for s in self.inputs], u),
                Named("parameter", [s.name for s in self.parameters], p),
            )
            rows = returned_rows(returned, of, where)
        expression = ca.densify(ca.vertcat(*rows))
        if expression.shape != (len(of), 1):
            raise ModelError(
                f"{where} returns {expression.shape[0]} values for "
                f"{len(of)}: {', '.join(s.name for s in of)}"
            )
        made = ca.Function(name, [x, u, p], [expression], ["x", "u", "p"], [name])
        if isinstance(given, ca.Function) and (known := remembered(given, self.theta)):
            remember(made, self.theta, known, by_parameters(given, self.theta))
        return made


def _label(s: Signal) -> str:
    return f"{s.name} [{s.unit}]" if s.unit else s.name
