"""Canonical form of a model that is affine in combinations of its parameters."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.errors import ModelError
from backsight.models._monomials import Monomial, show, terms
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Coordinates:
    """A chain in other coordinates than the states of the model.

    Parameters
    ----------
    chain, states : casadi.Function
        States x (n,) to chain z (n,), and back.
    slope : casadi.Function
        ``x -> (n, n)``, the derivative of z by x.
    linear : bool
        Whether it is the same everywhere.
    """

    chain: ca.Function
    states: ca.Function
    slope: ca.Function
    linear: bool


@dataclasses.dataclass(frozen=True)
class AffineForm:
    r"""A chain of integrators with unknown parameters at its end (eq. 6-7).

    .. math:: \dot x = A_0 x + \phi(x, u) + \psi(x, u) \theta, \qquad y = c_0 x = x_1

    with :math:`\dot x_i = x_{i+1} + \phi_i(x_1 \dots x_i, u)` and :math:`\psi` zero but for its
    last row. The :math:`\theta_i` are products of powers of the parameters, such as ``c/m``, and
    the parameters are products of powers of the :math:`\theta_i`.

    Parameters
    ----------
    n : int
        Number of states in the chain.
    states, parameters : tuple of str
        Names of the chain's states and of the model's constant states.
    combinations : tuple of str
        The theta as text.
    divisors : tuple of int
        The theta that some parameter is divided by.
    phi : casadi.Function
        ``(x, u) -> (n,)``.
    psi : casadi.Function
        ``(x, u) -> (p,)``, the last row.
    theta : casadi.Function
        Parameters to theta.
    physical : casadi.Function
        Theta to parameters.
    coordinates : Coordinates, optional
        If the chain is not made of the model's states, see `observer_form`.

    Source: Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
    estimation: a comparison to extended and unscented Kalman filter", eq. 4-7; Besançon (ed.),
    "Nonlinear Observers and Applications", Springer 2007.
    """

    n: int
    states: tuple[str, ...]
    parameters: tuple[str, ...]
    combinations: tuple[str, ...]
    divisors: tuple[int, ...]
    phi: ca.Function
    psi: ca.Function
    theta: ca.Function
    physical: ca.Function
    coordinates: Coordinates | None = None

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return self.phi.numel_in(1)

    @property
    def p(self) -> int:
        """Number of combinations."""
        return len(self.combinations)

    def chain(self, x: Array) -> Array:
        """States of the model (..., n) as the chain."""
        if self.coordinates is None:
            return x
        points = np.reshape(x, (-1, self.n)).T
        z = self.coordinates.chain.map(points.shape[1])(points)
        return np.asarray(z).T.reshape(x.shape)

    def rhs(self, x: ca.SX, theta: ca.SX, u: ca.SX) -> ca.SX:
        """Time derivative of the chain (n,), eq. 6."""
        dx = ca.vertcat(x[1:], 0) + self.phi.call([x, u])[0]
        if self.p:
            dx[self.n - 1] += ca.dot(self.psi.call([x, u])[0], theta)
        return dx


def affine_form(model: Model) -> AffineForm:
    """Bring a model with its unknown parameters among the states into canonical form.

    Parameters
    ----------
    model : Model
        Continuous; first a chain of states, then the parameters (`augment` makes such a model).

    Raises
    ------
    ModelError
        If the output is not the first state, the states are no chain of integrators, or a
        parameter does not enter by products in the last equation; the message shows the term that
        is in the way.
    """
    if not model.continuous:
        raise ModelError("the canonical form needs a continuous-time model")
    z, u = ca.SX.sym("z", model.nx), ca.SX.sym("u", model.nu)
    rhs = model.rhs(z, u)
    moving = moving_states(model)
    n = len(moving)
    names = [s.name for s in model.states]
    if n == 0 or moving != list(range(n)):
        raise ModelError("the canonical form needs the moving states first, then the parameters")
    x = ca.SX.sym("x", n)
    p = [ca.SX.sym(name) for name in names[n:]]
    free = ca.densify(ca.substitute(rhs, z, ca.vertcat(x, *p)))
    if model.ny != 1 or not ca.is_equal(model.output(z, u), z[0], 3):
        raise ModelError(f"the canonical form needs one output, the first state '{names[0]}'")
    rows = [_chain_row(free, x, i, names, p) for i in range(n - 1)]

    where = f"equation of '{names[n - 1]}'"
    parts = terms(free[n - 1], p, where)
    constant = parts.pop((0,) * len(p), ca.SX(0))
    monomials = list(parts)
    inverse = _inverse_exponents(monomials, names[n:], where)
    theta = ca.SX.sym("theta", len(monomials))
    vector = ca.vertcat(*p)
    psi = ca.Function("psi", [x, u], [ca.vertcat(*parts.values())])
    _check_independent(psi, [show(m, names[n:]) for m in monomials], where)
    return AffineForm(
        n=n,
        states=tuple(names[:n]),
        parameters=tuple(names[n:]),
        combinations=tuple(show(m, names[n:]) for m in monomials),
        divisors=tuple(int(i) for i in np.flatnonzero((inverse < 0).any(axis=0))),
        phi=ca.Function("phi", [x, u], [ca.vertcat(*rows, constant)]),
        psi=psi,
        theta=ca.Function("theta", [vector], [_products(vector, np.array(monomials))]),
        physical=ca.Function("physical", [theta], [_products(theta, inverse)]),
    )


def is_chain(model: Model) -> bool:
    """Whether the output is the first state and the moving states are a chain behind it."""
    z, u = ca.SX.sym("z", model.nx), ca.SX.sym("u", model.nu)
    n, names = len(moving_states(model)), [s.name for s in model.states]
    x, p = z[:n], ca.vertsplit(z[n:]) if model.nx > n else []
    rhs = ca.densify(model.rhs(z, u))
    try:
        for i in range(n - 1):
            _chain_row(rhs, x, i, names, p)
    except ModelError:
        return False
    return ca.is_equal(model.output(z, u), z[0], 3)


def moving_states(model: Model) -> list[int]:
    """States that are not constant by the equations of the model."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    change = model.rhs(x, u) if model.continuous else model.rhs(x, u) - x
    return sorted(set(ca.sparsify(ca.simplify(change)).sparsity().row()))


def _chain_row(rhs: ca.SX, x: ca.SX, i: int, names: list[str], p: list[ca.SX]) -> ca.SX:
    """phi_i of a row that must read x_{i+1} + phi_i(x_1 ... x_i, u)."""
    rest = ca.simplify(rhs[i] - x[i + 1])
    if ca.depends_on(rest, x[i + 1 :]):
        raise ModelError(
            f"equation of '{names[i]}': it must be '{names[i + 1]}' plus a function of "
            f"{', '.join(names[: i + 1])}, but is '{rhs[i]}'"
        )
    for symbol in p:
        if ca.depends_on(rest, symbol):
            raise ModelError(
                f"equation of '{names[i]}': parameter '{symbol}' may only enter the last equation"
            )
    return rest


def _inverse_exponents(monomials: list[Monomial], names: list[str], where: str) -> np.ndarray:
    """Exponents of the parameters as products of powers of theta."""
    found = ", ".join(show(m, names) for m in monomials) or "nothing"
    exponents = np.array(monomials, float).reshape(len(monomials), len(names))
    if len(monomials) != len(names) or abs(np.linalg.det(exponents)) < 1e-9:
        raise ModelError(
            f"{where}: the parameters {', '.join(names)} enter by {found}; these combinations do "
            "not determine them one by one"
        )
    return np.linalg.inv(exponents)


def _check_independent(psi: ca.Function, combinations: list[str], where: str) -> None:
    """Raise `ModelError` if some combinations enter by the same function of state and input."""
    if not combinations:
        return
    rng = np.random.default_rng(0)
    points = [rng.standard_normal((psi.numel_in(i), 20 * len(combinations))) for i in range(2)]
    values = np.asarray(psi.map(points[0].shape[1])(*points)).T
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < len(combinations):
        return
    size = np.abs(values).max(axis=0)
    *_, singular, directions = np.linalg.svd(values / np.where(size > 0, size, 1.0))
    if singular[-1] < 1e-9 * singular[0]:
        alike = [c for c, w in zip(combinations, directions[-1], strict=True) if abs(w) > 1e-6]
        raise ModelError(
            f"{where}: {', '.join(alike)} are multiplied by the same functions of state and input "
            "and cannot be told apart"
        )


def _products(base: ca.SX, exponents: np.ndarray) -> ca.SX:
    """Products of powers; whole exponents stay multiplications, so that signs are kept."""
    return ca.vertcat(*(_product(base, row) for row in exponents))


def _product(base: ca.SX, row: np.ndarray) -> ca.SX:
    result = ca.SX(1)
    for i, exponent in enumerate(row):
        whole = round(float(exponent))
        if abs(exponent - whole) > 1e-9:
            result = result * base[i] ** float(exponent)
        elif whole >= 0:
            for _ in range(whole):
                result = result * base[i]
        else:
            for _ in range(-whole):
                result = result / base[i]
    return result
