"""Choices become problem files that load, whatever the machine and the units are."""

import itertools
import tomllib

import numpy as np
import pytest

from backsight.data import list_columns
from backsight.errors import ProblemError
from backsight.problem import load
from backsight.problem.starting import noise_shown
from backsight.workbench._choices import METHODS, Choices, Quantity
from backsight.workbench._equations import read_equations
from backsight.workbench._gallery import GALLERY
from backsight.workbench._modelled import remarks_on
from backsight.workbench._preview import previews
from backsight.workbench._suggesting import completed, suggested
from backsight.workbench._writing import problem_text

N = 40


def recorded(folder, columns):
    """A recording with columns of these names, as listed."""
    rng = np.random.default_rng(5)
    path = folder / "some run.csv"
    rows = np.column_stack([0.01 * np.arange(N), rng.standard_normal((N, len(columns)))])
    lines = [",".join(["time [s]", *columns]), *(",".join(f"{v:.6f}" for v in r) for r in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return list_columns(path)


def written(choices, found, folder):
    """The problem file, loaded."""
    firsts = {name: seen.first for name, seen in previews(found).items()}
    path = folder / "problem.toml"
    text = problem_text(choices, found, found.path.name, firsts=firsts)
    path.write_text(text, encoding="utf-8")
    return load(path)


@pytest.mark.parametrize("key", GALLERY)
def test_every_machine_loads_with_every_choice_of_its_sensors(key, tmp_path):
    machine = GALLERY[key]
    slots = (*machine.inputs, *machine.outputs)
    found = recorded(tmp_path, [f"{s.name} [{s.unit}]" for s in slots])
    names = [s.name for s in machine.outputs]
    for measured in itertools.chain(*(itertools.combinations(names, k + 1) for k in range(3))):
        for driven in ({}, {s.name: s.name for s in machine.inputs}):
            outputs = {n: n for n in measured}
            begin = suggested(key, found).model_copy(update={"inputs": driven, "outputs": outputs})
            problem = written(completed(begin, found), found, tmp_path)
            assert {s.name for s in problem.model.outputs} == set(measured)
            assert list(problem.estimators) == list(METHODS)[:1]


@pytest.mark.parametrize("key", GALLERY)
def test_columns_are_told_by_their_units_and_their_names(key, tmp_path):
    machine = GALLERY[key]
    slots = (*machine.inputs, *machine.outputs)
    for column in ("{0.name} [{0.unit}]", "{0.meaning}"):
        found = recorded(tmp_path, [column.format(s) for s in reversed(slots)])
        choices = suggested(key, found)
        names = [column.format(s).partition(" [")[0] for s in slots]
        assert list({**choices.inputs, **choices.outputs}.values()) == names


def test_a_column_in_another_unit_is_converted_and_its_noise_too(tmp_path):
    found = recorded(tmp_path, ["position [mm]", "force [kN]"])
    choices = suggested("mass_spring", found)
    seen = found["position"].noise
    assert choices.noise["position"] == pytest.approx(1e-3 * seen, rel=0.01)
    problem = written(choices, found, tmp_path)
    assert problem.recording.outputs["position"].unit == "m"
    first = previews(found)["position"].first
    table = tomllib.loads(problem.text)
    assert table["prior"]["x0"]["q"] == pytest.approx(1e-3 * first, rel=1e-4)


@pytest.mark.parametrize(
    ("key", "columns", "factor"),
    [
        ("mass_spring", ["position_mm", "force_N"], 1e-3),
        ("mass_spring", ["position_left", "force_N"], None),
        ("motor", ["speed [1/min]", "current [A]"], np.pi / 30),
    ],
)
def test_units_that_only_the_machine_makes_clear(key, columns, factor, tmp_path):
    """The end of a name, and revolutions per minute, which the reader takes for a number."""
    found = recorded(tmp_path, columns)
    choices = suggested(key, found)
    (output,) = choices.outputs
    column = found[choices.outputs[output]]
    assert choices.noise[output] == pytest.approx((factor or 1.0) * column.noise, rel=0.01)
    table = written(choices, found, tmp_path).recording.outputs[output]
    assert table.factor == (None if factor is None else pytest.approx(factor, rel=1e-12))
    assert bool(remarks_on(column)) == (factor is not None)


def test_a_column_of_another_kind_is_not_proposed(tmp_path):
    found = recorded(tmp_path, ["speed [V]", "current [mV]"])
    choices = suggested("motor", found)
    assert not choices.inputs
    assert not choices.outputs
    with pytest.raises(ProblemError, match="output"):
        written(choices, found, tmp_path)


def test_equations_of_the_user_load_with_the_units_of_the_columns(tmp_path):
    found = recorded(tmp_path, ["F [N]", "place [m]"])
    choices = Choices(
        machine="equations",
        equations="q' = v # velocity\nv' = (F - k*q - 1e-3*v)/m\n\nplace = q\n",
        inputs={"F": "F"},
        outputs={"place": "place"},
    )
    choices = completed(choices, found)
    assert list(choices.quantities) == ["k", "m"]
    quantities = {"k": Quantity(value=5.0, sigma=1.0), "m": Quantity(value=2.0)}
    problem = written(choices.model_copy(update={"quantities": quantities}), found, tmp_path)
    units = {s.name: s.unit for s in problem.model.states}
    assert units == {"q": "m", "v": "m/s", "k": ""}
    assert [s.name for s in problem.model.parameters] == ["m"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no state yet"),
        ("v' = 1\nv == 2", "line 2"),
        ("v' = 1\n3 = 2", "line 2"),
        ("v' = 1\nv' = 2", "an equation already"),
        ("y = 2", "no state yet"),
    ],
)
def test_equations_that_are_none_are_told_by_their_line(text, said):
    with pytest.raises(ProblemError, match=said):
        read_equations(text)


def test_what_wanders_changes_by_the_root_of_the_time(tmp_path):
    found = recorded(tmp_path, ["current [A]", "speed [rad/s]"])
    choices = suggested("motor", found)
    table = tomllib.loads(written(choices, found, tmp_path).text)
    # After the 100 samples of a second the walk has the variance that was asked for.
    change = choices.quantities["load"].change
    assert table["estimate"]["load"]["walk"] == pytest.approx(change / np.sqrt(100), rel=1e-2)
    assert "walk" not in table["estimate"]["J"]


def test_the_noise_of_a_fine_encoder_is_what_it_shows(tmp_path):
    """On a long axis it is a small part of the range; only what shows none gets a guess."""
    t = 0.01 * np.arange(400)
    rough = 2.5 * np.sin(t) + 1e-5 * np.random.default_rng(1).standard_normal(400)
    for name, values, right in (("fine", rough, 1e-5), ("smooth", 2.5 * np.sin(t), 5e-4)):
        path = tmp_path / f"{name}.csv"
        rows = [f"{a:.2f},{v:.9f}" for a, v in zip(t, values, strict=True)]
        path.write_text("\n".join(["time [s],position [m]", *rows]) + "\n", encoding="utf-8")
        found = list_columns(path)
        assert noise_shown(found["position"]) == pytest.approx(right, rel=0.2)
