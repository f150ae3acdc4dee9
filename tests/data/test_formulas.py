"""Columns that are arithmetic on others."""

import numpy as np
import pytest

from backsight.data import read
from backsight.errors import DataError

RNG = np.random.default_rng(4)
ROOF, GROUND = RNG.standard_normal(20), RNG.standard_normal(20)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "run.csv"
    cells = [[f"{v!r}" for v in x.tolist()] for x in (ROOF, GROUND)]
    cells[1][5] = ""
    rows = [f"{0.1 * k:.1f},{a},{b},x" for k, (a, b) in enumerate(zip(*cells, strict=True))]
    file.write_text("t,Acc roof [g],ground,note\n" + "\n".join(rows))
    return file


def taken(path, text, **more):
    given = {"inputs": {}, "outputs": {"a": {"name": "new", "unit": "g"}}, "time": "t"}
    return read(path, **given, formulas={"new": text, "unused": "ground"}, **more)


def test_a_formula_is_a_column(path):
    found = taken(path, "Acc_roof - 2*ground**2 + sin(pi/2)")
    right = ROOF - 2 * GROUND**2 + 1
    right[5] = np.nan
    np.testing.assert_allclose(found.y.values[:, 0], right, rtol=1e-14)
    assert found.output_unit.item() == "g"


def test_columns_and_formulas_stand_beside_each_other(path):
    outputs = {"a": "r", "b": "ground"}
    found = read(path, inputs={}, outputs=outputs, time="t", formulas={"r": "ground/2"})
    np.testing.assert_array_equal(found.y.values[:, 0], found.y.values[:, 1] / 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("roof - ground", "formula 'new'.*unknown name 'roof'"),
        ("ground -", "the formula ends"),
        ("__import__('os')", "unknown"),
        ("2*pi", "uses no column"),
        ("note + ground", "unknown name 'note'"),
    ],
)
def test_what_is_no_formula_is_refused(path, text, message):
    with pytest.raises(DataError, match=message):
        taken(path, text)


def test_a_formula_takes_no_column_away(path):
    with pytest.raises(DataError, match="has the name of a column"):
        read(path, inputs={}, outputs={"a": "ground"}, time="t", formulas={"ground": "Acc_roof"})
