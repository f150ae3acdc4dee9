"""Dataclasses from tables, with fields of every kind."""

import dataclasses

import pytest

from backsight.errors import ProblemError, TuningError
from backsight.estimators import ESTIMATORS, Limit, LinearMHE, Noise, Prior
from backsight.problem.methods import methods
from backsight.problem.reading.settings import built
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Small:
    size: float = 1.0

    def __post_init__(self):
        if self.size < 0:
            raise TuningError(f"size is {self.size}")


@dataclasses.dataclass(frozen=True)
class Large:
    size: int = 2


@dataclasses.dataclass(frozen=True)
class Method:
    gain: Array
    model: str
    poles: complex | tuple[complex, ...] = -1.0
    part: Small | Large = dataclasses.field(default_factory=Small)
    extra: Large | None = None
    limit: float | None = None
    fast: bool = False


def made(**given):
    return built(Method, {"gain": [1, 2]} | given, where="m.A", fixed={"model": "any"})


def test_every_kind_of_field():
    m = made(
        poles=[-1, "-2 + 1j"],
        part={"kind": "Large", "size": 3},
        extra={"size": 4},
        limit=5,
        fast=True,
    )
    assert m.gain.tolist() == [1.0, 2.0]
    assert m.poles == (-1.0, -2 + 1j)
    assert (m.part, m.extra) == (Large(3), Large(4))
    assert (m.limit, m.fast, m.model) == (5.0, True, "any")


def test_what_is_not_given_keeps_its_default():
    m = made(part={"size": 2})
    assert (m.part, m.poles, m.extra, m.limit, m.fast) == (Small(2.0), -1.0, None, None, False)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"pols": 1}, "m.A.pols: unknown key, did you mean 'poles'?"),
        ({"model": "own"}, "m.A.model: unknown key, "),
        ({"gain": ["a"]}, "m.A.gain: must be a list of numbers"),
        ({"poles": True}, 'm.A.poles: must be a number, or text like "-1+2j", not true'),
        ({"poles": "x"}, "m.A.poles: must be a number, or text"),
        ({"poles": [-1, "x"]}, "m.A.poles[1]: must be a number, or text"),
        ({"fast": 1}, "m.A.fast: must be true or false, not 1"),
        ({"limit": "5"}, "m.A.limit: must be a number, not '5'"),
        ({"part": 5}, "m.A.part: must be a table, not 5"),
        ({"extra": 5}, "m.A.extra: must be a table, not 5"),
        ({"part": {"kind": "large"}}, "m.A.part.kind: unknown kind 'large', did you mean 'Large'?"),
        (
            {"part": {"kind": "Large", "size": 1.5}},
            "m.A.part.size: must be a whole number, not 1.5",
        ),
        ({"part": {"size": -1.0}}, "m.A.part: size is -1.0"),
    ],
)
def test_wrong_values_are_named(given, message):
    with pytest.raises(ProblemError) as caught:
        made(**given)
    assert str(caught.value).startswith(message)


def test_a_missing_value_is_named():
    with pytest.raises(ProblemError, match=r"^m\.A\.gain: is missing$"):
        built(Method, {}, where="m.A", fixed={"model": "any"})


def test_the_list_of_methods_names_every_setting():
    listed = methods()
    for key, kind in ESTIMATORS.items():
        assert f'kind = "{key}"' in listed
        assert kind.title in listed
        for field in dataclasses.fields(kind):
            assert field.name in ("noise", "prior") or f"{field.name} = " in listed


def test_limits_are_a_list_of_tables():
    limit = {"name": "push", "weights": {"v": 2, "q": 1.5}, "upper": 3.0, "of": "noise"}
    fixed = {"noise": Noise(sigma_y=1.0), "prior": Prior(sigma_x0=1.0)}
    found = built(LinearMHE, {"limits": [limit]}, where="m.A", fixed=fixed)
    assert found.limits == (Limit("push", {"v": 2.0, "q": 1.5}, upper=3.0, of="noise"),)
    wrong = limit | {"weights": {"v": "much"}}
    with pytest.raises(ProblemError, match=r"m\.A\.limits\[0\]\.weights\.v: must be a number"):
        built(LinearMHE, {"limits": [wrong]}, where="m.A", fixed=fixed)
