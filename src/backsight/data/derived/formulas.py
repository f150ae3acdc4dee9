"""Columns that are arithmetic on other columns of a file."""

import re
from collections.abc import Iterable, Mapping

import casadi as ca
import numpy as np

from backsight.algebra.expressions import CONSTANTS, FUNCTIONS, expression
from backsight.errors import DataError, ModelError
from backsight.types import Array

_NAME = re.compile(r"[^\W\d]\w*")


def columns_in(formulas: Mapping[str, str], columns: Iterable[str]) -> dict[str, str]:
    """Names in formulas to the columns that they mean.

    A column whose name is no word is meant by its letters and digits with ``_`` between them:
    ``Acc_roof`` for ``Acc roof``, ``run_acc`` for ``run/acc``.

    Raises
    ------
    DataError
        If a formula is none (with the column of the text), names what is no column, or has the name
        of one.
    """
    words: dict[str, list[str]] = {}
    columns = list(columns)
    for column in columns:
        words.setdefault(re.sub(r"\W+", "_", column).strip("_"), []).append(column)
    plain = {word: meant[0] for word, meant in words.items() if len(meant) == 1}
    plain |= {column: column for column in columns if _NAME.fullmatch(column)}
    used: dict[str, str] = {}
    for name, text in formulas.items():
        if name in columns:
            raise DataError(f"formula '{name}' has the name of a column; give it another")
        _expression(name, text, {word: ca.SX.sym(word) for word in plain})
        found = set(_NAME.findall(text)) & set(plain)
        used |= {word: plain[word] for word in found if word not in {*FUNCTIONS, *CONSTANTS}}
    return used


def evaluated(
    formulas: Mapping[str, str], meant: Mapping[str, str], columns: Mapping[str, Array]
) -> dict[str, Array]:
    """Values of formulas, (n,) each, sample by sample; NaN where a column that they use is NaN."""
    results = {}
    for name, text in formulas.items():
        symbols = {word: ca.SX.sym(word) for word in meant}
        value = _expression(name, text, symbols)
        used = [word for word in meant if ca.depends_on(value, symbols[word])]
        if not used:
            raise DataError(f"formula '{name}' uses no column")
        lengths = {len(columns[meant[word]]) for word in used}
        if len(lengths) > 1:
            raise DataError(
                f"formula '{name}' uses columns of different lengths: {sorted(lengths)}"
            )
        function = ca.Function("formula", [symbols[word] for word in used], [value])
        rows = [columns[meant[word]][None, :] for word in used]
        missing = np.isnan(np.vstack(rows)).any(axis=0)
        results[name] = np.where(missing, np.nan, np.asarray(function(*rows)).ravel())
    return results


def _expression(name: str, text: str, symbols: Mapping[str, ca.SX]) -> ca.SX:
    try:
        return expression(text, symbols, where=f"formula '{name}'")
    except ModelError as error:
        raise DataError(str(error)) from None
