"""What a description must refuse when it is built: tried on every field of every one."""

import collections.abc
import dataclasses
import math
import re
import typing

import numpy as np
import pytest
from numpy.typing import ArrayLike

import backsight as bs
from backsight.description import Called, Description, Range, words
from backsight.errors import BacksightError, TuningError
from backsight.estimators import ESTIMATORS
from backsight.models.model import Model
from backsight.settings import Limit
from description.everything import descriptions, example, hints, modules, options

FIELDS = [(kind, name) for kind in descriptions() for name in hints(kind)]
NUMBERS = (int, float, complex)


def extras(hint: object) -> list[object]:
    """What `Annotated` adds, at any depth."""
    own = typing.get_args(hint)[1:] if typing.get_origin(hint) is typing.Annotated else ()
    return [*own, *(e for inner in typing.get_args(hint) for e in extras(inner))]


def is_number(option: object) -> bool:
    return option in NUMBERS or typing.get_origin(option) is np.ndarray


def wrong_values(hint: object) -> list[object]:
    """Values that a field of this annotation must refuse, whatever else it may be."""
    may, allowed = options(hint), [e for e in extras(hint) if isinstance(e, Range)]
    wrong: list[object] = [object(), object]
    wrong += [None] if type(None) not in may else []
    wrong += [True, np.True_] if bool not in may else []
    wrong += ["mistaken"] if str not in may else []
    wrong += [3.5] if not any(is_number(o) for o in may) and ArrayLike not in may else []
    if any(is_number(o) for o in may) and not any(e.missing for e in allowed):
        wrong += [math.nan]
        wrong += [math.inf, -math.inf] if not any(e.infinite for e in allowed) else []
        wrong += [-1] if any(e.lower >= 0 for e in allowed) else []
        wrong += [0] if any(e.above or e.lower >= 1 for e in allowed) else []
        wrong += [1.5] if int in may else []
    return wrong


def test_every_setting_belongs_to_a_description():
    public = [getattr(bs, name) for name in dir(bs) if not name.startswith("_")]
    found = {k for k in public if isinstance(k, type) and dataclasses.is_dataclass(k)} - {Model}
    new = [*found, *ESTIMATORS.values()]
    while new:
        kind = new.pop()
        assert issubclass(kind, Description), kind
        inner = [o for hint in hints(kind).values() for o in options(hint)]
        inner += [typing.get_args(o)[0] for o in inner if typing.get_origin(o) is tuple]
        more = {o for o in inner if isinstance(o, type) and dataclasses.is_dataclass(o)} - found
        found |= more
        new += more
    assert {"Noise", "Carryover", "Atoms", "GaussNewton"} <= {k.__name__ for k in found}


@pytest.mark.parametrize("kind", descriptions(), ids=lambda k: k.__name__)
def test_the_least_that_is_needed_is_accepted(kind):
    made = kind(**example(kind))
    assert dataclasses.replace(made) is not made


@pytest.mark.parametrize(("kind", "name"), FIELDS, ids=lambda v: getattr(v, "__name__", v))
def test_wrong_values_are_refused_by_name(kind, name):
    hint = hints(kind)[name]
    called = [e.name for e in extras(hint) if isinstance(e, Called)]
    for value in wrong_values(hint):
        with pytest.raises(BacksightError) as caught:
            kind(**example(kind) | {name: value})
        assert type(caught.value) is kind.refusal
        message = str(caught.value)
        assert message.startswith(f"{kind.called or kind.__name__}: ")
        assert any(n in message for n in (name, *called)), message


@pytest.mark.parametrize(("kind", "name"), FIELDS, ids=lambda v: getattr(v, "__name__", v))
def test_misspelled_words_are_corrected(kind, name):
    known = words(hints(kind)[name])
    for word in known:
        with pytest.raises(kind.refusal, match=f"unknown .* '{word}x'.* '{word}'"):
            kind(**example(kind) | {name: f"{word}x"})
        accepted = kind.__new__(kind)
        object.__setattr__(accepted, name, word)
        assert getattr(accepted, name) == word


def test_words_are_literals():
    """Where a docstring lists words, the annotation has the same; and no setting is bare text."""
    listed = re.compile(r"^ *(\w+) : \{((?:\"[\w-]+\"(?:, )?)+)\}", re.MULTILINE)
    seen = 0
    # What the engine says to itself is no setting.
    for module in (m for m in modules() if not m.__name__.startswith("backsight.engine.")):
        for owner in vars(module).values():
            if getattr(owner, "__module__", "") != module.__name__ or not callable(owner):
                continue
            for name, text in listed.findall(owner.__doc__ or ""):
                plain_class = isinstance(owner, type) and not dataclasses.is_dataclass(owner)
                described = owner.__init__ if plain_class else owner
                hint = typing.get_type_hints(described, include_extras=True)[name]
                given = [w for o in options(hint) for w in typing.get_args(o)]
                assert set(given) == set(re.findall(r"\"([\w-]+)\"", text)), (owner, name)
                seen += 1
    assert seen >= 24
    for kind in descriptions():
        for field in dataclasses.fields(kind):
            assert str not in options(hints(kind)[field.name]) or field.default in (
                dataclasses.MISSING,
                "",
            ), f"{kind.__name__}.{field.name} has a word as default: use Literal"


def test_everything_is_said_at_once():
    with pytest.raises(TuningError) as caught:
        bs.MHE("x", bs.Prior(1.0), N=0, lag=-1, optimiser=None, constant=("a", "a"), soft={"q": 0})
    said = str(caught.value)
    for part in (
        "MHE: noise is 'x'; it must be a Noise",
        "the horizon N is 0; it must be a whole number from 1 on",
        "the lag is -1; it must be a whole number from 0 on",
        "optimiser is None; it must be a GaussNewton",
        "constant: 'a' is named twice",
        "the weight of 'q' is 0; it must be positive",
    ):
        assert part in said
    assert said.count("; it must be") == 5


def test_what_several_fields_say_is_told_with_the_rest():
    with pytest.raises(
        TuningError, match=r"RecursiveMHE: alpha is 2; .* 1; every = 9 is more than"
    ):
        bs.RecursiveMHE(bs.Noise(sigma_y=1.0), bs.Prior(1.0), N=4, every=9, alpha=2)


def test_covariances_are_judged_before_there_is_a_model():
    wrong = {
        "not symmetric": [[1.0, 2.0], [3.0, 4.0]],
        "not positive semidefinite: its smallest eigenvalue is -1": [[1.0, 2.0], [2.0, 1.0]],
        "square matrix": [1.0, 2.0],
        "not finite": [[np.nan]],
        "array of numbers": [["a"]],
    }
    for message, R in wrong.items():
        with pytest.raises(TuningError, match=message):
            bs.Noise(R=R)
    assert bs.Noise(R=[[0.0]]).R == [[0.0]]  # a sensor without noise, which a few methods take
    for settings in ({"Q": -np.eye(2)}, {"Qc": -np.eye(2)}):
        with pytest.raises(TuningError, match=r"Qc? is not positive semidefinite"):
            bs.Noise(sigma_y=1.0, **settings)
    with pytest.raises(TuningError, match="P0 is not positive semidefinite"):
        bs.Prior(P0=-np.eye(2))
    with pytest.raises(TuningError, match="P is not positive semidefinite"):
        bs.settings.ConstantArrival(-np.eye(2))
    with pytest.raises(TuningError, match=r"must not be negative and be finite for b \(-1\)"):
        bs.Noise(sigma_y={"a": 1.0, "b": -1.0})


def test_names_are_judged_before_there_is_a_model():
    noise, prior = bs.Noise(sigma_y=1.0), bs.Prior(1.0)
    wrong: dict[str, collections.abc.Callable[[], object]] = {
        "no unknown force is named": lambda: bs.JointInput(noise, prior, forces=()),
        "'F' is named twice": lambda: bs.JointInput(noise, prior, forces=("F", "F")),
        "forces is 'F1'; it must be a tuple of text": lambda: bs.JointInput(
            noise, prior, forces="F1"
        ),
        "'G' is none of the forces": lambda: bs.CompressiveSensingMHE(
            noise, prior, forces=("F",), lam=1.0, nonnegative=("G",)
        ),
        "'a' is used twice": lambda: bs.LinearMHE(
            noise,
            prior,
            limits=(Limit("a", {"x": 1.0}), Limit("a", {"y": 1.0})),
        ),
    }
    for message, build in wrong.items():
        with pytest.raises(TuningError, match=message):
            build()


def test_numbers_of_numpy_are_numbers_and_lists_are_tuples():
    noise, prior = bs.Noise(sigma_y=np.float32(1.0)), bs.Prior(np.int64(1))
    made = bs.CompressiveSensingMHE(
        noise, prior, forces=["F", "G"], lam=np.float64(2.0), N=np.int32(4), threshold=1
    )
    assert made.forces == ("F", "G")
    assert hash(bs.Luenberger(noise, prior, poles=[0.5, np.float64(0.2)]).poles)
    with pytest.raises(TuningError, match=r"N is 4\.0; it must be a whole number"):
        dataclasses.replace(made, N=4.0)
    with pytest.raises(TuningError, match="the class NoArrival"):
        bs.MHE(noise, prior, arrival=bs.settings.NoArrival)


BELOW_ZERO = {
    "AHG": "gain",
    "AdaptiveGain": "lower gamma beta window every up down",
    "CompressiveSensingMHE": "lam N sigma_force threshold lag",
    "Excitation": "window",
    "GaussNewton": "max_iterations tolerance cost_tolerance step_tolerance",
    "Greedy": "penalty",
    "HGO": "gain",
    "Hits": "samples number spacing margin least steps places",
    "Integrator": "substeps",
    "JointInput": "sigma_force",
    "LinearMHE": "N arrival_weight",
    "MHE": "N lag",
    "MHO": "N alpha",
    "NoArrival": "width",
    "Noise": "sigma_y sigma_w",
    "Prior": "sigma_x0",
    "QuasiNewton": "max_iterations cost_tolerance step_tolerance",
    "RecursiveMHE": "N alpha every reinitialise",
    "Reweighted": "iterations floor",
    "Signal": "scale",
    "UKF": "alpha",
    "UKFArrival": "alpha",
}
"""Settings that mean nothing below zero, whatever their annotations say."""


@pytest.mark.parametrize("kind", BELOW_ZERO)
def test_what_means_nothing_below_zero_is_refused(kind):
    described = next(k for k in descriptions() if k.__name__ == kind)
    for name in BELOW_ZERO[kind].split():
        with pytest.raises(described.refusal, match=f"{name}.* is -1"):
            described(**example(described) | {name: -1})
    for name in {"arrival_weight", "alpha"} & set(BELOW_ZERO[kind].split()):
        if kind in ("LinearMHE", "RecursiveMHE"):
            with pytest.raises(described.refusal, match=f"{name} is 1.5; it must be from 0 to 1"):
                described(**example(described) | {name: 1.5})
