"""The equations of a model in LaTeX, read from its functions' own instructions."""

import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from backsight.models.model import Model

LONGEST = 400
"""Characters of LaTeX that an equation may take; longer ones are not shown."""

GREEK = re.compile(
    "alpha|beta|[gG]amma|[dD]elta|epsilon|zeta|eta|[tT]heta|kappa|[lL]ambda|mu|nu|xi|rho|[sS]igma"
    "|tau|[pP]hi|chi|[pP]si|[oO]mega"
)

SUM, PRODUCT, POWER, ATOM = range(4)
"""How strongly the outermost operation of an expression binds."""

Text = tuple[str, int]
"""LaTeX, and how strongly it binds."""

FUNCTIONS = {
    ca.OP_SIN: r"\sin", ca.OP_COS: r"\cos", ca.OP_TAN: r"\tan", ca.OP_ASIN: r"\arcsin",
    ca.OP_ACOS: r"\arccos", ca.OP_ATAN: r"\arctan", ca.OP_SINH: r"\sinh", ca.OP_COSH: r"\cosh",
    ca.OP_TANH: r"\tanh", ca.OP_EXP: r"\exp", ca.OP_LOG: r"\ln", ca.OP_FMIN: r"\min",
    ca.OP_FMAX: r"\max", ca.OP_SIGN: r"\operatorname{sign}", ca.OP_ATAN2: r"\operatorname{atan2}",
    ca.OP_ERF: r"\operatorname{erf}", ca.OP_FMOD: r"\operatorname{mod}",
    ca.OP_FLOOR: r"\operatorname{floor}", ca.OP_CEIL: r"\operatorname{ceil}",
}  # fmt: skip

RELATIONS = {ca.OP_LT: "<", ca.OP_LE: r"\le", ca.OP_EQ: "=", ca.OP_NE: r"\ne"}
LOGIC = {ca.OP_AND: r"\land", ca.OP_OR: r"\lor"}


def latex(model: "Model") -> list[str]:
    """Write state equation and output equation in LaTeX, one formula per state and output.

    Formulas longer than `LONGEST` are replaced by dots: nobody reads them, and a large structure
    would fill pages.
    """
    names = [[symbol(s.name) for s in g] for g in (model.states, model.inputs, model.parameters)]
    dots = (r"\dot{%s}" if model.continuous else "{%s}^{+}") % "%s"
    left = [dots % symbol(s.name) for s in model.states]
    outputs = [symbol(s.name) for s in model.outputs]
    rows = [*zip(left, _rows(model.f, names), strict=True)]
    rows += [*zip(outputs, _rows(model.h, names), strict=True)]
    return [f"{name} = {text}" for name, text in rows]


def symbol(name: str) -> str:
    """Write a name as a symbol: Greek letters as such, the rest after ``_`` as an index."""
    head, *index = [part for part in name.split("_") if part] or [""]
    numbered = re.fullmatch(r"([A-Za-z]+)(\d+)", head)
    if numbered:
        head, index = numbered.group(1), [numbered.group(2), *index]
    word = head if len(head) == 1 else rf"\mathrm{{{head}}}"
    letter = rf"\{head}" if GREEK.fullmatch(head) else word
    index = [part if part.isdigit() or len(part) == 1 else rf"\mathrm{{{part}}}" for part in index]
    return letter + (f"_{{{','.join(index)}}}" if index else "")


def _rows(function: ca.Function, names: Sequence[Sequence[str]]) -> list[str]:
    """One formula per row of the only result of an SX function."""
    work: dict[int, Text] = {}
    rows = ["0"] * function.nnz_out(0)
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[targets[0]] = names[sources[0]][sources[1]], ATOM
        elif operation == ca.OP_CONST:
            work[targets[0]] = _number(function.instruction_constant(k))
        elif operation == ca.OP_OUTPUT:
            rows[targets[1]] = work[sources[0]][0]
        else:
            text, binds = _operation(operation, [work[s] for s in sources])
            work[targets[0]] = (text if len(text) <= LONGEST else r"\ldots", binds)
    return rows


def _operation(operation: int, given: Sequence[Text]) -> Text:
    if operation in WRITTEN:
        return WRITTEN[operation](*given)
    texts = [text for text, _ in given]
    if operation in RELATIONS | LOGIC:
        sign = (RELATIONS | LOGIC)[operation]
        return f"({texts[0]} {sign} {texts[1]})", ATOM
    name = FUNCTIONS.get(operation, r"\operatorname{f}")
    return rf"{name}\left({', '.join(texts)}\right)", ATOM


def _within(given: Text, least: int) -> str:
    """An expression in parentheses, unless it binds strongly enough."""
    text, binds = given
    return text if binds >= least else rf"\left({text}\right)"


def _sum(a: Text, b: Text) -> Text:
    return (f"{a[0]} - {b[0][1:].lstrip()}" if b[0].startswith("-") else f"{a[0]} + {b[0]}"), SUM


def _product(a: Text, b: Text) -> Text:
    # A number goes in front, and two numbers need a sign between them.
    a, b = (b, a) if _is_number(b) and not _is_number(a) else (a, b)
    sign = r" \cdot " if _is_number(b) else r"\, "
    return f"{_within(a, PRODUCT)}{sign}{_within(b, PRODUCT)}", PRODUCT


def _is_number(given: Text) -> bool:
    return given[0][:1].isdigit()


def _number(value: float) -> Text:
    mantissa, _, exponent = f"{value:.6g}".partition("e")
    if exponent:
        mantissa = rf"{mantissa} \cdot 10^{{{int(exponent)}}}"
    return mantissa, SUM if value < 0 else PRODUCT if exponent else ATOM


WRITTEN: dict[int, Callable[..., Text]] = {
    ca.OP_ADD: _sum,
    ca.OP_SUB: lambda a, b: (f"{a[0]} - {_within(b, PRODUCT)}", SUM),
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: (rf"\frac{{{a[0]}}}{{{b[0]}}}", PRODUCT),
    ca.OP_NEG: lambda a: (f"-{_within(a, PRODUCT)}", SUM),
    ca.OP_INV: lambda a: (rf"\frac{{1}}{{{a[0]}}}", PRODUCT),
    ca.OP_SQ: lambda a: (f"{_within(a, ATOM)}^{{2}}", POWER),
    ca.OP_TWICE: lambda a: (rf"2\, {_within(a, PRODUCT)}", PRODUCT),
    ca.OP_SQRT: lambda a: (rf"\sqrt{{{a[0]}}}", ATOM),
    ca.OP_FABS: lambda a: (rf"\left|{a[0]}\right|", ATOM),
    ca.OP_POW: lambda a, b: (f"{_within(a, ATOM)}^{{{b[0]}}}", POWER),
    ca.OP_CONSTPOW: lambda a, b: (f"{_within(a, ATOM)}^{{{b[0]}}}", POWER),
    ca.OP_IF_ELSE_ZERO: lambda a, b: (rf"\left[{a[0]}\right]\, {_within(b, PRODUCT)}", PRODUCT),
    ca.OP_NOT: lambda a: (rf"\lnot {_within(a, ATOM)}", PRODUCT),
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_LIFT: lambda a, _: a,
}
"""Operations that are not written as a function of their arguments."""
