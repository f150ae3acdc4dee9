"""A JSON schema of problem files, with which an editor completes and checks them as one writes.

It is derived from what reads them: the tables of the file and the fields of the estimators.
"""

import copy
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np

from backsight.description import Range, first_sentence, meanings_of, plain, without_marks
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import PluginError
from backsight.estimators import ALL_ESTIMATORS
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.forces.moving_load import moving_load
from backsight.models.lti import lti
from backsight.models.text.equations import from_equations
from backsight.problem.reading.kinds import ALL_KINDS, EquationsTable, LtiTable
from backsight.problem.reading.settings import dataclasses_in, fields_of, required
from backsight.problem.reading.tables import (
    ALARMS,
    FEEDS,
    SINKS,
    EstimatorTable,
    MovingTable,
    NoiseTable,
    PriorTable,
    ProblemTable,
    StrictTable,
)
from backsight.problem.reading.uncertain import RULES

DRAFT = "http://json-schema.org/draft-07/schema#"
"""What editors for TOML know."""

_REFERENCE = "#/definitions/{model}"
_SHARED = ("noise", "prior")
"""Fields of estimators that are tables with names of their own."""

_EXPLAINED: Mapping[type[StrictTable], Any] = {
    NoiseTable: Noise,
    PriorTable: Prior,
    MovingTable: moving_load,
    EquationsTable: from_equations,
    LtiTable: lti,
}
"""Table to the class or function whose arguments it holds."""

_SINGLE: dict[Any, dict[str, Any]] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    complex: {"type": ["number", "string"]},
    str: {"type": "string"},
}

Schema = dict[str, Any]


def json_schema(*, tell: Callable[[str], None] = lambda _: None) -> Schema:
    """Return the JSON schema of problem files, with the kinds that installed extensions bring.

    It knows every key, which values are of the right kind, words and ranges. Whether names fit the
    model is for `load` to say.

    Parameters
    ----------
    tell : callable
        Told, a sentence at a time, which extensions are broken and left out.
    """
    schema = ProblemTable.model_json_schema(ref_template=_REFERENCE)
    definitions = schema.pop("$defs")
    properties = schema["properties"]
    kinds = {k: _table(t, definitions) for k, t in _working(ALL_KINDS, tell).items()}
    properties["model"] = _by_kind(kinds)
    properties["integrator"] = _object(Integrator, ())
    definitions["NoiseTable"]["properties"]["outliers"] = _one_of(RULES)
    _explain(definitions["EstimatorTable"], EstimatorTable)
    common = definitions.pop("EstimatorTable")["properties"]
    own = {name: common[name] for name in EstimatorTable.model_fields if name != "kind"}
    settings = {key: _estimator(kind, own) for key, kind in _working(ALL_ESTIMATORS, tell).items()}
    properties["estimators"]["additionalProperties"] = _by_kind(settings)
    for name, tables in (("source", FEEDS), ("alarm", ALARMS), ("sink", SINKS)):
        properties[name]["additionalProperties"] = _by_kind(
            {kind: _named_by_kind(table, definitions) for kind, table in tables.items()}
        )
    for table in _tables(StrictTable):
        if table.__name__ in definitions:
            _explain(definitions[table.__name__], table)
    _explain(schema, ProblemTable)
    titled = {"$schema": DRAFT, "title": "Problem file of Backsight"}
    return _without_titles({**titled, **schema, "definitions": definitions})


def _working(known: Mapping[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
    found = {}
    for key in known:
        try:
            found[key] = known[key]
        except PluginError as error:
            tell(str(error))
    return found


def _table(table: type[StrictTable], definitions: Schema) -> Schema:
    schema = table.model_json_schema(ref_template=_REFERENCE)
    definitions |= schema.pop("$defs", {})
    _explain(schema, table)
    # A parameter that is estimated need not be here, and None is "not given" in every table.
    return schema | {"required": [n for n in schema.get("required", ()) if n != "kind"]}


def _named_by_kind(table: type[StrictTable], definitions: Schema) -> Schema:
    """A table whose own key `kind` says which one it is."""
    schema = _table(table, definitions)
    del schema["properties"]["kind"]
    return schema


def _tables(table: type[StrictTable]) -> list[type[StrictTable]]:
    """Every kind of table that is derived from one."""
    found = table.__subclasses__()
    return found + [inner for t in found for inner in _tables(t)]


def _explain(schema: Schema, table: type[StrictTable]) -> None:
    """Put in what the docstring of a table, or of what it describes, says of its keys."""
    of = getattr(table, "function", None) or _EXPLAINED.get(table)
    said = (meanings_of(of) if of else {}) | meanings_of(table)
    for short in schema.get("anyOf", [schema]):  # a table may be given by one value alone
        if "properties" in short:
            short["description"] = without_marks(first_sentence(table))
            for name, entry in short["properties"].items():
                if said.get(name):
                    entry["description"] = without_marks(said[name])


def _estimator(kind: type, common: Schema) -> Schema:
    schema = _object(kind, _SHARED)
    schema["properties"] = copy.deepcopy(common) | schema["properties"]
    return schema | {"description": getattr(kind, "title", "")}


def _by_kind(schemas: Mapping[str, Schema]) -> Schema:
    """One of several tables, by the key `kind`; without it, an editor lists the kinds."""
    branches = [
        {
            "if": {"properties": {"kind": {"const": key}}, "required": ["kind"]},
            "then": _with_kind(schema, key),
        }
        for key, schema in schemas.items()
    ]
    named = {"kind": {"enum": sorted(schemas)}}
    return {"type": "object", "properties": named, "required": ["kind"], "allOf": branches}


def _with_kind(schema: Schema, key: str) -> Schema:
    properties = {"kind": {"const": key}, **schema["properties"]}
    return {**schema, "properties": properties}


def _object(kind: type, left_out: Sequence[str]) -> Schema:
    """Table of the fields of a dataclass, with what its docstring says of them."""
    fields = [f for f in fields_of(kind) if f.init and f.name not in left_out]
    hints = typing.get_type_hints(kind, include_extras=True)
    said = meanings_of(kind)
    properties = {}
    for field in fields:
        schema = _schema(hints[field.name])
        properties[field.name] = schema | (
            {"description": without_marks(d)} if (d := said.get(field.name)) else {}
        )
        if isinstance(field.default, bool | int | float | str):
            properties[field.name]["default"] = field.default
    return {
        "type": "object",
        "properties": properties,
        "required": [f.name for f in fields if required(f)],
        "additionalProperties": False,
    }


def _one_of(parts: Sequence[type]) -> Schema:
    """Table of one of several dataclasses; `kind` names it, or it is the first."""
    if len(parts) == 1:
        return _object(parts[0], ())
    branches = []
    for part in parts:
        schema = _with_kind(_object(part, ()), part.__name__)
        needed = [] if part is parts[0] else ["kind"]
        branches.append(schema | {"required": [*needed, *schema["required"]]})
    return {"anyOf": branches}


def _schema(hint: Any) -> Schema:
    """What a field may be in TOML, by its annotation."""
    if typing.get_origin(hint) is Annotated:
        first, *extras = typing.get_args(hint)
        within = next((e for e in extras if isinstance(e, Range)), None)
        return _ranged(_schema(first), within)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        parts = dataclasses_in(hint)
        options = [o for o in args if plain(o) not in (*parts, types.NoneType)]
        schemas = [*([_one_of(parts)] if parts else []), *map(_schema, options)]
        return schemas[0] if len(schemas) == 1 else {"anyOf": schemas}
    if origin is Literal:
        return {"enum": list(args)}
    if origin is np.ndarray:
        return {"type": ["array", "number"]}
    if origin is tuple or (isinstance(origin, type) and issubclass(origin, Sequence)):
        return {"type": "array", "items": _schema(args[0])}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(args[1])}
    if parts := dataclasses_in(hint):
        return _one_of(parts)
    return dict(_SINGLE.get(hint, {}))


def _ranged(schema: Schema, within: Range | None) -> Schema:
    if within is None or schema.get("type") not in ("number", "integer"):
        return schema
    bounds = {}
    if np.isfinite(within.lower):
        bounds["exclusiveMinimum" if within.above else "minimum"] = within.lower
    if np.isfinite(within.upper):
        bounds["maximum"] = within.upper
    return schema | bounds


def _without_titles(node: Any) -> Any:
    """Drop the titles that are only names again, but the one of the whole and keys called so."""
    if isinstance(node, list):
        return [_without_titles(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    cleaned = {}
    for key, value in node.items():
        if key == "title" and isinstance(value, str) and "$schema" not in node:
            continue
        cleaned[key] = _without_titles(value)
    return cleaned
