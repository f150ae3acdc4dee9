"""Check a model and a reader of one's own."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from backsight.models.model import Model
from backsight.testing.close import require


def check_model(model: Model) -> None:
    """Check that a model can be estimated with: its equations and derivatives at its values.

    Raises
    ------
    AssertionError
        If a rate, an output or a derivative is not finite, or an output depends on no state.
    """
    require(isinstance(model, Model), f"it is no Model but {type(model).__name__}")
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rate, output = model.rhs(x, u), model.output(x, u)
    expressions = {
        "the rate": (rate, model.states),
        "the output": (output, model.outputs),
        "the derivative of the rate of": (ca.sum2(ca.jacobian(rate, x)), model.states),
        "the derivative of the output": (ca.sum2(ca.jacobian(output, x)), model.outputs),
    }
    at = [np.array([s.value for s in model.states]), np.zeros(model.nu)]
    for what, (expression, signals) in expressions.items():
        values = np.asarray(ca.Function("at", [x, u], [ca.densify(expression)])(*at)).ravel()
        wrong = [s.name for s, v in zip(signals, values, strict=True) if not np.isfinite(v)]
        require(not wrong, f"{what} {', '.join(wrong)} is not finite at the model's values")
    seen = np.asarray(ca.sum2(ca.DM(ca.jacobian(output, x).sparsity(), 1))).ravel() > 0
    blind = [s.name for s, any_ in zip(model.outputs, seen, strict=True) if not any_]
    require(not blind, f"the output {', '.join(blind)} depends on no state")


def check_reader(
    reader: Callable[[Path, Sequence[str]], Mapping[str, object]],
    path: Path,
    *,
    columns: Sequence[str],
) -> None:
    """Check a reader on a file with known columns.

    Parameters
    ----------
    reader : callable
        ``(path, wanted) -> {name: values}``, see `backsight.read`.
    path : Path
        A file that it reads.
    columns : sequence of str
        Names of columns that are in the file.

    Raises
    ------
    AssertionError
        If a column is missing or is no vector of numbers, lengths differ, one that is not in the
        file is found, or a second reading finds something else.
    """
    found, again = (reader(path, list(columns)) for _ in range(2))
    require(isinstance(found, Mapping), "it must return columns by name")
    arrays = {}
    for name in columns:
        require(name in found, f"the column '{name}' is missing")
        values = np.asarray(found[name], float)
        require(values.ndim == 1, f"'{name}' has the shape {values.shape}; time is its only axis")
        same = np.array_equal(values, np.asarray(again[name], float), equal_nan=True)
        require(same, f"'{name}' is something else at a second reading")
        arrays[name] = values
    lengths = {name: len(values) for name, values in arrays.items()}
    require(len(set(lengths.values())) == 1, f"the numbers of samples differ: {lengths}")
    nowhere = "no column of this name"
    try:
        invented = nowhere in reader(path, [nowhere])
    except Exception:
        invented = False
    require(not invented, "it finds a column that is not in the file")
