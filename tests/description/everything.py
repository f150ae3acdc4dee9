"""All descriptions of the package, found in it, and an instance of each."""

import dataclasses
import importlib
import pkgutil
import types
import typing
from collections.abc import Mapping

import numpy as np

import backsight
from backsight.description import Description, plain
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import Noise, Prior
from backsight.estimators.dictionaries import ForceLine
from backsight.estimators.varied_noise import NoisePart
from backsight.tune import Choice


def modules() -> list[types.ModuleType]:
    """Every module of the package but the one that runs it."""
    found = pkgutil.walk_packages(backsight.__path__, "backsight.")
    names = [m.name for m in found if not m.name.endswith(("__main__", "._backsight"))]
    return [importlib.import_module(name) for name in names]


def descriptions() -> list[type]:
    """All descriptions that can be built, by name."""
    modules()
    found, new = set(), [Description]
    while new:
        kind = new.pop()
        found |= {kind}
        new += kind.__subclasses__()
    ours = [k for k in found if k.__module__.startswith("backsight.")]
    whole = [
        k for k in ours if not getattr(k, "__abstractmethods__", None) and k is not Description
    ]
    return sorted(whole, key=lambda kind: kind.__name__)


def hints(kind: type) -> dict[str, object]:
    """Annotations of the fields that are given when a description is built."""
    found = typing.get_type_hints(kind, include_extras=True)
    return {f.name: found[f.name] for f in dataclasses.fields(kind) if f.init}


def options(hint: object) -> list[object]:
    """What a field may be, without what `Annotated` adds: the members of a union, or itself."""
    hint = plain(hint)
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return [o for option in typing.get_args(hint) for o in options(option)]
    return [hint]


def example(kind: type) -> dict[str, object]:
    """The arguments that a description needs at least."""
    if issubclass(kind, Noise):
        return {"sigma_y": 1.0}
    if kind is NoisePart:
        return {"factors": ("a", "a"), "Q": np.eye(2)}
    if kind is Choice:
        return {"name": "N", "options": (5, 10)}
    if kind is Prior:
        return {"sigma_x0": 1.0}
    if kind is ForceLine:
        return {"places": (0.5, 1.0)}
    needed = [f for f in dataclasses.fields(kind) if f.init and f.default is dataclasses.MISSING]
    needed = [f for f in needed if f.default_factory is dataclasses.MISSING]
    return {f.name: _value(options(hints(kind)[f.name])[0], f.name) for f in needed}


def _value(option: object, name: str) -> object:
    origin, args = typing.get_origin(option), typing.get_args(option)
    made = {float: 0.5, int: 40, str: "name"}
    if option in made:
        return made[option]
    if origin is tuple:
        kinds = args[:1] if args[-1] is Ellipsis else args
        return tuple(_value(k if k is not complex else float, name) for k in map(plain, kinds))
    if origin is typing.Literal:
        return args[0]
    if origin is Mapping:
        return {"x": 1.0}
    if option in (Noise, Prior):
        return option(**example(option))
    if option is Integrator:
        return Integrator()
    if option is ForceLine:
        return ForceLine(**example(option))
    return np.eye(2)
