"""Write an expression as a sum of products (monomial of the parameters) x (rest)."""

from collections.abc import Sequence

import casadi as ca

from backsight.errors import ModelError

Monomial = tuple[int, ...]
"""Exponent of every parameter."""

Terms = dict[Monomial, ca.SX]
"""The rest that belongs to every monomial."""

MOST_TERMS = 500


def terms(expression: ca.SX, parameters: Sequence[ca.SX], where: str) -> Terms:
    """Expand a scalar expression into monomials of the parameters.

    Parameters
    ----------
    expression : (1, 1) SX
    parameters : sequence of scalar symbols
    where : str
        Named in error messages, for instance "equation of 'v'".

    Raises
    ------
    ModelError
        If a parameter is inside a function or in the divisor together with something else; the
        message shows that term.
    """
    return _Expansion(list(parameters), where).of(expression)


def show(monomial: Monomial, names: Sequence[str]) -> str:
    """Text of a monomial: ``c/m``, ``1/m``, ``k*b**2``."""
    above = [_power(n, e) for n, e in zip(names, monomial, strict=True) if e > 0]
    below = [_power(n, -e) for n, e in zip(names, monomial, strict=True) if e < 0]
    text = "*".join(above) or "1"
    if not below:
        return text
    return f"{text}/{below[0]}" if len(below) == 1 else f"{text}/({'*'.join(below)})"


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}**{exponent}"


class _Expansion:
    def __init__(self, parameters: list[ca.SX], where: str) -> None:
        self.where = where
        self.one: Monomial = (0,) * len(parameters)
        self.index = {p.element_hash(): i for i, p in enumerate(parameters)}
        self.vector = ca.vertcat(*parameters)
        self.done: dict[int, Terms] = {}

    def of(self, e: ca.SX) -> Terms:
        key = e.element_hash()
        if key not in self.done:
            self.done[key] = self._expand(e)
            if len(self.done[key]) > MOST_TERMS:
                raise ModelError(f"{self.where}: more than {MOST_TERMS} terms in the parameters")
        return self.done[key]

    def _expand(self, e: ca.SX) -> Terms:
        if e.element_hash() in self.index:
            power = list(self.one)
            power[self.index[e.element_hash()]] = 1
            return {tuple(power): ca.SX(1)}
        if not ca.depends_on(e, self.vector):
            return {self.one: e}
        deps = [self.of(e.dep(i)) for i in range(e.n_dep())] if self._is_algebraic(e) else []
        match e.op():
            case ca.OP_ADD:
                return _sum(deps[0], deps[1])
            case ca.OP_SUB:
                return _sum(deps[0], _scaled(deps[1], -1))
            case ca.OP_NEG:
                return _scaled(deps[0], -1)
            case ca.OP_TWICE:
                return _scaled(deps[0], 2)
            case ca.OP_MUL:
                return _product(deps[0], deps[1])
            case ca.OP_SQ:
                return _product(deps[0], deps[0])
            case ca.OP_DIV:
                return _product(deps[0], self._inverse(e, deps[1]))
            case ca.OP_INV:
                return self._inverse(e, deps[0])
        raise ModelError(f"{self.where}: the parameters must enter as products, not in '{e}'")

    @staticmethod
    def _is_algebraic(e: ca.SX) -> bool:
        return e.op() in {
            ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_MUL, ca.OP_SQ, ca.OP_DIV, ca.OP_INV,
        }  # fmt: skip

    def _inverse(self, e: ca.SX, divisor: Terms) -> Terms:
        if len(divisor) != 1:
            raise ModelError(f"{self.where}: the divisor in '{e}' is a sum with parameters in it")
        ((monomial, rest),) = divisor.items()
        return {tuple(-k for k in monomial): 1 / rest}


def _sum(a: Terms, b: Terms) -> Terms:
    total = dict(a)
    for monomial, rest in b.items():
        total[monomial] = total[monomial] + rest if monomial in total else rest
    return total


def _scaled(a: Terms, factor: float) -> Terms:
    return {monomial: factor * rest for monomial, rest in a.items()}


def _product(a: Terms, b: Terms) -> Terms:
    total: Terms = {}
    for m, r in a.items():
        for n, s in b.items():
            total = _sum(total, {tuple(i + j for i, j in zip(m, n, strict=True)): r * s})
    return total
