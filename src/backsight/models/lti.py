"""Linear models: from matrices to a model, and back."""

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.algebra.degree import degrees
from backsight.errors import ModelError
from backsight.models._affine import Affine, remember, remembered
from backsight.models.model import Model, Signals
from backsight.models.signals import signals
from backsight.types import Array

_LINEAR_OPERATIONS = {
    ca.OP_INPUT,
    ca.OP_OUTPUT,
    ca.OP_CONST,
    ca.OP_ADD,
    ca.OP_SUB,
    ca.OP_NEG,
    ca.OP_TWICE,
    ca.OP_MUL,
    ca.OP_DIV,
}


def lti(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike | None = None,
    *,
    states: Signals,
    inputs: Signals,
    outputs: Signals,
    dt: float | None = None,
    name: str = "lti",
) -> Model:
    r"""Build a linear time-invariant model :math:`\dot x = A x + B u,\; y = C x + D u`.

    Parameters
    ----------
    A : (nx, nx) array
        State matrix.
    B : (nx, nu) array
        Input matrix; ``(nx, 0)`` for a model without inputs.
    C : (ny, nx) array
        Output matrix.
    D : (ny, nu) array, optional
        Feedthrough; zero if not given.
    states, inputs, outputs : dict
        Name to unit, ``(value, unit)`` or `Signal`, in the order of the rows and columns.
    dt : float, optional
        Sampling period [s]; the matrices are then those of :math:`x^+ = A x + B u`.
    name : str
        Shown in results.

    Raises
    ------
    ModelError
        If a matrix has the wrong size or an entry that is not a finite number.

    Examples
    --------
    >>> import numpy as np
    >>> fall = bs.lti(
    ...     [[0, 1], [0, 0]],
    ...     [[0], [1]],
    ...     [[1, 0]],
    ...     states={"q": "m", "v": "m/s"},
    ...     inputs={"a": "m/s2"},
    ...     outputs={"y": "m"},
    ... )
    >>> [s.name for s in fall.states]
    ['q', 'v']
    """
    x, u, y = signals(states, "state"), signals(inputs, "input"), signals(outputs, "output")
    nx, nu, ny = len(x), len(u), len(y)
    feedthrough = np.zeros((ny, nu)) if D is None else D
    matrices, problems = {}, []
    for what, given, shape, meaning in (
        ("A", A, (nx, nx), "states x states"),
        ("B", B, (nx, nu), "states x inputs"),
        ("C", C, (ny, nx), "outputs x states"),
        ("D", feedthrough, (ny, nu), "outputs x inputs"),
    ):
        try:
            matrices[what] = _finite_matrix(given, what, shape, meaning)
        except ModelError as error:
            problems.append(str(error))
    if problems:
        raise ModelError(f"model '{name}': " + "; ".join(problems))

    z = ca.SX.sym("x", nx), ca.SX.sym("u", nu), ca.SX.sym("p", 0)
    a, b, c, d = (ca.sparsify(ca.DM(matrices[n])) for n in "ABCD")
    f = ca.Function("f", z, [ca.mtimes(a, z[0]) + ca.mtimes(b, z[1])])
    h = ca.Function("h", z, [ca.mtimes(c, z[0]) + ca.mtimes(d, z[1])])
    remember(f, np.zeros(0), (matrices["A"], matrices["B"], np.zeros(nx)))
    remember(h, np.zeros(0), (matrices["C"], matrices["D"], np.zeros(ny)))
    return Model(
        f=f,
        h=h,
        states=x,
        inputs=u,
        outputs=y,
        dt=dt,
        name=name,
    )


def state_space(model: Model) -> tuple[Array, Array, Array, Array]:
    """Matrices A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu) of a linear model.

    The parameters are taken at their values. Linearity is decided on the expressions, not by trying
    numbers: the Jacobians must not depend on the states and inputs.

    Raises
    ------
    ModelError
        If an equation is nonlinear or has a constant term; all such equations are named.
    """
    known = state_equation(model), output_equation(model)
    if known[0] and known[1] and not (known[0][2].any() or known[1][2].any()):
        return (*known[0][:2], *known[1][:2])
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    z = ca.vertcat(x, u)
    f, h = ca.SX(model.rhs(x, u)), ca.SX(model.output(x, u))
    problems = [
        *_nonlinear(f, z, [f"the equation of '{s.name}'" for s in model.states]),
        *_nonlinear(h, z, [f"the output equation of '{s.name}'" for s in model.outputs]),
    ]
    if problems:
        raise ModelError(f"model '{model.name}' is not linear: " + "; ".join(problems))
    rows = _slopes(ca.Function("rows", [z], [ca.vertcat(f, h)]))
    F, H = rows[: model.nx], rows[model.nx :]
    return F[:, : model.nx], F[:, model.nx :], H[:, : model.nx], H[:, model.nx :]


def is_linear(model: Model) -> bool:
    """Whether `state_space` has matrices for a model."""
    try:
        state_space(model)
    except ModelError:
        return False
    return True


def bent(model: Model) -> list[str]:
    """Equations that are not linear in the states, in words; none if the model is.

    The inputs may do anything: a model with ``a * cos(w * t)`` is linear in its states if t is an
    input. Every operation is looked at, since a step such as sign(v) has a derivative of zero.
    """
    if remembered(model.f, model.theta) and remembered(model.h, model.theta):
        return []
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    labels = [f"the equation of '{s.name}'" for s in model.states]
    labels += [f"the output equation of '{s.name}'" for s in model.outputs]
    rows = ca.vertcat(ca.SX(model.rhs(x, u)), ca.SX(model.output(x, u)))
    found = degrees(ca.Function("rows", [x, u], [ca.densify(rows)]))
    return [label for label, d in zip(labels, found, strict=True) if d > 1]


def coefficients(model: Model, *, outputs: bool = False) -> ca.Function:
    """``u -> (A, b)`` of a model that is linear in its states, f = A x + b; or of its outputs."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rows = model.output(x, u) if outputs else model.rhs(x, u)
    still = ca.SX.zeros(model.nx)
    found = [ca.jacobian(rows, x), rows]
    A, b = (ca.densify(ca.substitute(k, x, still)) for k in found)
    return ca.Function("coefficients", [u], [A, b])


def state_equation(model: Model) -> Affine | None:
    """Matrices A (nx, nx), B (nx, nu) and constants c (nx,) of the rates A x + B u + c.

    The parameters are taken at their values. None if a rate is not linear in states and inputs, or
    an entry is not finite.
    """
    return _affine(model, model.f)


def output_equation(model: Model) -> Affine | None:
    """Matrices C (ny, nx), D (ny, nu) and constants (ny,) of the outputs, see `state_equation`."""
    return _affine(model, model.h)


def _affine(model: Model, equation: ca.Function) -> Affine | None:
    if known := remembered(equation, model.theta):
        return known
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    z = ca.vertcat(x, u)
    f = ca.densify(ca.SX(equation.call([x, u, ca.SX(model.theta)])[0]))
    found = None
    if not any(ca.which_depends(f, z, 2, True)) and _operations(f, z) <= _LINEAR_OPERATIONS:
        c = np.array(ca.Function("constants", [z], [f])(np.zeros(z.numel()))).ravel()
        if c.any():  # a difference to them would lose digits
            slopes = np.array(ca.evalf(ca.densify(ca.jacobian(f, z))))
        else:
            slopes = _slopes(ca.Function("rows", [z], [f]))
        if np.isfinite(slopes).all() and np.isfinite(c).all():
            found = slopes[:, : model.nx], slopes[:, model.nx :], c
    if found:
        remember(equation, model.theta, found)
    return found


def remember_slopes(equation: ca.Function, theta: Sequence[float]) -> None:
    """Note the matrices of a function ``(x, u, p)`` that is linear and without constants."""
    z = ca.SX.sym("z", sum(equation.numel_in(i) for i in range(3)))
    nx, nu = equation.numel_in(0), equation.numel_in(1)
    rows = equation.call([z[:nx], z[nx : nx + nu], z[nx + nu :]])
    by_x, by_u, by_p = np.split(_slopes(ca.Function("rows", [z], rows)), [nx, nx + nu], axis=1)
    values = np.array(theta, float)
    remember(equation, values, (by_x, by_u, by_p @ values), by_p)


def _slopes(linear: ca.Function) -> Array:
    """Matrix of a function that is linear and without constants, column by column.

    Of many states a Jacobian of expressions takes minutes.
    """
    n = linear.numel_in(0)
    if not n:
        return np.zeros((linear.numel_out(0), 0))
    return np.array(ca.densify(linear.map(n)(np.eye(n)))).reshape(-1, n)


def _operations(rows: ca.SX, z: ca.SX) -> set[int]:
    function = ca.Function("rows", [z], [rows])
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def _finite_matrix(given: ArrayLike, what: str, shape: tuple[int, int], meaning: str) -> Array:
    if np.iscomplexobj(given):
        raise ModelError(f"{what} holds complex numbers; give real ones")
    try:
        whole: Any = given
        matrix = np.asarray(whole.toarray() if scipy.sparse.issparse(given) else given, float)
    except (OverflowError, TypeError, ValueError):
        raise ModelError(f"{what} is not a matrix of numbers") from None
    if matrix.shape != shape:
        raise ModelError(f"{what} has the shape {matrix.shape}; it must be {shape}, {meaning}")
    if not np.isfinite(matrix).all():
        row, column = np.argwhere(~np.isfinite(matrix))[0]
        raise ModelError(
            f"{what} is not finite in row {row + 1}, column {column + 1}: {matrix[row, column]}"
        )
    return matrix


def _nonlinear(rows: ca.SX, z: ca.SX, labels: Iterable[str]) -> list[str]:
    found = []
    bent = ca.which_depends(rows, z, 2, True)
    constants = np.array(ca.Function("rows", [z], [rows])(np.zeros(z.numel()))).ravel()
    if not (any(bent) or constants.any()) and _operations(rows, z) <= _LINEAR_OPERATIONS:
        return []
    for i, label in enumerate(labels):
        # A step such as sign(v) has a zero derivative, so the Jacobian alone would not show it.
        if bent[i] or not _operations(rows[i], z) <= _LINEAR_OPERATIONS:
            found.append(f"{label} is nonlinear")
            continue
        constant = float(ca.Function("row", [z], [rows[i]])(np.zeros(z.numel())))
        if constant != 0:
            found.append(f"{label} has the constant term {constant:g}; make it an input")
    return found
