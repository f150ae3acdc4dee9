"""Observer form of a model with one output: the output and its derivatives as coordinates."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.errors import ModelError, TuningError
from backsight.models.canonical.affine import (
    AffineForm,
    Coordinates,
    affine_form,
    is_chain,
    moving_states,
)
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array

SINGULAR = 1e-10
"""Smallest singular value of the scaled change of coordinates, as a share of the largest."""


def observer_form(model: Model) -> AffineForm:
    r"""Bring a model into the form that high-gain observers need, eq. 1-4.

    A chain with the output at its beginning (see `affine_form`) is left as it is. Else the
    coordinates are the output and its Lie derivatives without input, by symbolic derivatives:

    .. math:: z = \Phi(x) = (h,\ L_f h,\ \dots,\ L_f^{n-1} h)

    .. math:: \dot z_i = z_{i+1} + \phi_i(z_1 \dots z_i, u), \qquad
              \dot z_n = \phi_n(z, u) + \psi(z, u) \theta, \qquad y = z_1

    The input may enter every equation, but before the last one only together with the z up to
    there, whatever u(t) is: uniform observability. An observer of z is one of x with the gain
    :math:`(\partial\Phi/\partial x)^{-1} \lambda \Lambda^{-1} k_0`.

    Parameters
    ----------
    model : Model
        Continuous, one output; first the states that move, then the parameters to estimate
        (see `moving_first`).

    Raises
    ------
    ModelError
        If the input or a parameter enters where it must not, the output and its derivatives do not
        determine the states, or their way back is not found; the message shows the term that is in
        the way. The way back is found if every z_i contains one more state than those before, and
        that one linearly, or if all contain all states linearly.

    References
    ----------
    Gauthier, Hammouri, Othman (1992), doi:10.1109/9.256352. Riva, Dagen, Ortmaier, "Adaptive
    high-gain observer for joint state and parameter estimation: a comparison to extended and
    unscented Kalman filter", section 2.1.
    """
    if model.ny != 1:
        raise ModelError(f"the observer form needs one output; the model has {model.ny}")
    if not model.continuous or not moving_states(model) or is_chain(model):
        return affine_form(model)
    n, names = len(moving_states(model)), [s.name for s in model.states]
    x, u = ca.SX.sym("x", n), ca.SX.sym("u", model.nu)
    p = ca.vertcat(*(ca.SX.sym(name) for name in names[n:]))
    symbols = ca.vertcat(*(ca.SX.sym(name) for name in names[:n]))
    chain = _Chain(model, ca.substitute(symbols, symbols, x), u, p)
    z = ca.SX.sym("z", n)
    back = chain.solved(z)
    free = ca.SX.sym("s", model.nx)
    rows = ca.substitute(chain.rows(z, back), ca.vertcat(p, z), ca.vertcat(free[n:], free[:n]))
    parameters = ca.SX.sym("p", len(model.parameters))
    states = tuple(Signal(name=f"d{i}_{model.outputs[0].name}") for i in range(n))
    moved = dataclasses.replace(
        model,
        f=ca.Function("f", [free, u, parameters], [ca.vertcat(rows, ca.SX.zeros(p.numel()))]),
        h=ca.Function("h", [free, u, parameters], [free[0]]),
        states=(*states, *model.states[n:]),
        virtual=None,
    )
    slope = ca.jacobian(chain.z, x)
    coordinates = Coordinates(
        chain=ca.Function("chain", [x], [chain.z]),
        states=ca.Function("states", [z], [back]),
        slope=ca.Function("slope", [x], [ca.densify(slope)]),
        linear=not ca.depends_on(slope, x),
    )
    return dataclasses.replace(affine_form(moved), states=tuple(names[:n]), coordinates=coordinates)


def moving_first(model: Model) -> tuple[Model, list[int]]:
    """The model with the states that move first, and which of the states come in this order."""
    moving = moving_states(model)
    order = moving + [i for i in range(model.nx) if i not in moving]
    if order == list(range(model.nx)):
        return model, order
    place = np.argsort(order).tolist()
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    given = [x[place], u, p]
    ordered = dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], [model.f.call(given)[0][order]]),
        h=ca.Function("h", [x, u, p], model.h.call(given)),
        states=tuple(model.states[i] for i in order),
        virtual=None,
    )
    return ordered, order


def gain_vector(poles: complex | tuple[complex, ...], n: int) -> Array:
    """k0 (n,) that places the eigenvalues of A0 - k0 c0.

    Parameters
    ----------
    poles : number or n numbers
        One number: n-fold. Complex ones in conjugate pairs; all with negative real part.
    """
    wanted = np.atleast_1d(np.asarray(poles, complex))
    if wanted.size == 1:
        wanted = np.repeat(wanted, n)
    if wanted.shape != (n,):
        raise TuningError(f"poles has {wanted.size} entries; the chain has {n} states")
    if not np.all(np.real(wanted) < 0):
        raise TuningError(f"poles {wanted.tolist()} must all have a negative real part")
    polynomial = np.poly(wanted)
    if np.any(np.abs(np.imag(polynomial)) > 1e-9):
        raise TuningError(f"complex poles {wanted.tolist()} must come in conjugate pairs")
    return np.real(polynomial[1:]).astype(float)


class _Chain:
    """The output and its derivatives in the states x (n,): `z`, and what the input adds."""

    def __init__(self, model: Model, x: ca.SX, u: ca.SX, p: ca.SX) -> None:
        self.x, self.u, n = x, u, x.numel()
        self.names, self.output = [s.name for s in model.states], model.outputs[0].name
        full = ca.vertcat(x, p)
        f = ca.densify(model.rhs(full, u))[:n]
        z, driven = [ca.densify(model.output(full, u))], []
        if ca.depends_on(z[0], u):
            raise ModelError(
                f"output '{self.output}' contains the input: '{self._shown(z[0])}'; an observer "
                "form has none in it"
            )
        self._check_parameters(z[0], p, 0)
        for i in range(n):
            slope = ca.jacobian(z[i], x) @ f  # L_f z_i
            if i == n - 1:
                self.last = slope
                break
            self._check_parameters(slope, p, i + 1)
            still = ca.simplify(ca.substitute(slope, u, ca.SX.zeros(u.numel())))
            z.append(ca.densify(still))
            driven.append(self._driven(slope, still))
        self.z, self.driven = ca.vertcat(*z), driven

    def _driven(self, slope: ca.SX, still: ca.SX) -> ca.SX:
        """What the input adds to a derivative."""
        if not ca.depends_on(slope, self.u):
            return ca.SX(0)
        by_input = ca.jacobian(slope, self.u)
        return slope - still if ca.depends_on(by_input, self.u) else by_input @ self.u

    def rows(self, z: ca.SX, back: ca.SX) -> ca.SX:
        """Derivatives of z in z, (n,)."""
        rows = []
        for i, driven in enumerate(self.driven):
            added = ca.substitute(driven, self.x, back)
            if ca.depends_on(added, z[i + 1 :]):
                raise ModelError(
                    f"{self._row(i)}: the input enters by '{self._shown(driven)}', which is no "
                    "function of the output and its derivatives up to there; then the states are "
                    "not observable for every input, and there is no observer form"
                )
            rows.append(z[i + 1] + added)
        return ca.vertcat(*rows, ca.substitute(self.last, self.x, back))

    def solved(self, z: ca.SX) -> ca.SX:
        """The states x by z, (n,)."""
        slope = ca.jacobian(self.z, self.x)
        if not ca.depends_on(slope, self.x):
            A = np.asarray(ca.evalf(slope))
            self._check_regular(A)
            offset = ca.substitute(self.z, self.x, ca.SX.zeros(self.x.numel()))
            return ca.sparsify(ca.DM(np.linalg.inv(A))) @ (z - offset)
        found: dict[int, ca.SX] = {}
        for i in range(z.numel()):
            self._solve_next(found, z, i)
        return ca.vertcat(*(found[k] for k in range(z.numel())))

    def _solve_next(self, found: dict[int, ca.SX], z: ca.SX, i: int) -> None:
        """Solve z_i for the one state in it that is not `found`."""
        known = list(found)
        e = self.z[i]
        if known:
            e = ca.substitute(e, self.x[known], ca.vertcat(*found.values()))
        unknown = [k for k in range(self.x.numel()) if k not in found]
        here = [k for k in unknown if ca.depends_on(e, self.x[k])]
        slope = ca.jacobian(e, self.x[here[0]]) if len(here) == 1 else None
        if slope is None or ca.depends_on(slope, self.x[here[0]]):
            names = ", ".join(self.names[k] for k in here) or "none"
            raise ModelError(
                f"observer form: {self._derivative(i)} of '{self.output}' is "
                f"'{self._shown(self.z[i])}'; it must contain one state that those before do not "
                f"contain, and that one linearly, but there is {names}"
            )
        found[here[0]] = (z[i] - ca.substitute(e, self.x[here[0]], 0)) / slope

    def _check_regular(self, A: np.ndarray) -> None:
        size = np.abs(A).max(axis=1, keepdims=True)
        rows = A / np.where(size > 0, size, 1.0)
        columns = np.abs(rows).max(axis=0)
        scaled = rows / np.where(columns > 0, columns, 1.0)
        *_, singular, directions = np.linalg.svd(scaled)
        if not singular[-1] > SINGULAR * singular[0]:
            hidden = [n for n, w in zip(self.names, directions[-1], strict=False) if abs(w) > 1e-6]
            raise ModelError(
                f"the output '{self.output}' and its derivatives do not determine "
                f"{', '.join(hidden)}: not observable"
            )

    def _check_parameters(self, expression: ca.SX, p: ca.SX, i: int) -> None:
        n = self.x.numel()
        for k in range(p.numel()):
            if ca.depends_on(expression, p[k]):
                raise ModelError(
                    f"observer form: parameter '{self.names[n + k]}' enters "
                    f"{self._derivative(i)} of '{self.output}', '{self._shown(expression)}'; it "
                    f"may only enter {self._derivative(n)}"
                )

    def _row(self, i: int) -> str:
        """How an equation is called: by the state, if z_i is one."""
        for k in range(self.x.numel()):
            if ca.is_equal(self.z[i], self.x[k], 3):
                return f"equation of '{self.names[k]}'"
        return f"{self._derivative(i + 1)} of '{self.output}'"

    def _derivative(self, i: int) -> str:
        return "the output" if i == 0 else f"derivative {i}"

    def _shown(self, expression: ca.SX) -> str:
        names = ca.vertcat(*(ca.SX.sym(name) for name in self.names[: self.x.numel()]))
        return str(ca.substitute(expression, self.x, names))
