"""Write docs/keys.md: every key of problem files, from the schema of what reads them."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from backsight.problem.json_schema import json_schema

PAGE = Path(__file__).with_name("keys.md")

HEAD = """# Keys of problem files

Every key that `backsight run` reads, with what it may be; what has no default may be left out
unless it must be given. `backsight schema` prints the same for editors;
[problem files](problem-files.md) shows how they go together.
"""

Schema = dict[str, Any]

OF_A_NAME = ("estimate", "disturbances", "forces", "moving", "virtual", "dummy")
"""Tables of which there is one for each name."""


def page() -> str:
    """The whole page."""
    schema = json_schema()
    tables = schema["properties"]
    parts = [HEAD, _section("The file", schema, schema)]
    for name, entry in tables.items():
        if name in ("model", "estimators", "source", "alarm", "sink"):
            continue
        title = f"[{name}.NAME]" if name in OF_A_NAME else f"[{name}]"
        inner = entry["additionalProperties"] if name in OF_A_NAME else entry
        if table := _table(inner, schema):
            parts.append(_section(f"`{title}`", table, schema))
        if name == "recording":
            parts += _of_recordings(schema)
        if name == "readings":
            parts.append(
                _section("An output of `[readings]`", _part("ReadingTable", schema), schema)
            )
    parts += [
        "## `[model]`\n\n`kind` says which of these it is.\n",
        *_kinds(tables["model"], schema),
    ]
    estimators = tables["estimators"]["additionalProperties"]
    parts += ["## `[estimators.NAME]`\n\n`kind` says which method it is.\n"]
    parts += _kinds(estimators, schema)
    kinds = {
        "source": "where samples come from",
        "alarm": "what it looks at",
        "sink": "where estimates go",
    }
    for name, about in kinds.items():
        parts += [f"## `[{name}.NAME]`\n\nOf `backsight live`; `kind` says {about}.\n"]
        parts += _kinds(tables[name]["additionalProperties"], schema)
    return "\n".join(parts)


def _of_recordings(schema: Schema) -> Iterator[str]:
    """What stands inside `[recording]`: what inherits keys has its own only."""
    column = _part("ColumnTable", schema)
    yield _section("A column", column, schema)
    for title, name in (("an input", "CommandColumnTable"), ("an output", "SensorColumnTable")):
        yield _section(f"A column of {title}", _beside(_part(name, schema), column), schema)
    yield _section("`gaps` of an input", _part("GapsTable", schema), schema)
    source = _beside(_part("SourceTable", schema), _part("RecordingTable", schema))
    source["description"] += " It has all keys of `[recording]`, and"
    yield _section("`[recording.sources.NAME]`", source, schema)


def _part(name: str, schema: Schema) -> Schema:
    """A table by the name of its definition."""
    found = _table({"$ref": f"#/definitions/{name}"}, schema)
    assert found is not None
    return found


def _beside(table: Schema, base: Schema) -> Schema:
    """The keys that another table does not have."""
    own = {n: e for n, e in table["properties"].items() if n not in base["properties"]}
    return {**table, "properties": own}


def _kinds(by_kind: Schema, schema: Schema) -> Iterator[str]:
    for branch in by_kind["allOf"]:
        table = branch["then"]
        kind = table["properties"]["kind"]["const"]
        yield _section(f'`kind = "{kind}"`', table, schema, level="###")


def _section(title: str, table: Schema, schema: Schema, *, level: str = "##") -> str:
    needed = table.get("required", ())
    about = _escaped(table.get("description", ""))
    rows = []
    for name, entry in table["properties"].items():
        if "const" in entry:
            continue
        default = "must be given" if name in needed else _default(entry)
        said = _escaped(entry.get("description", ""))
        rows.append(f"| `{name}` | {_escaped(_kind_of(entry, schema))} | {default} | {said} |")
    head = "| key | is | default | meaning |\n|---|---|---|---|\n"
    return f"{level} {title}\n\n{about}\n\n{head}" + "\n".join(rows) + "\n"


def _table(entry: Schema, schema: Schema) -> Schema | None:
    """The table that an entry is, None if it is a mapping of names to values."""
    if "$ref" in entry:
        return _table(schema["definitions"][entry["$ref"].rpartition("/")[2]], schema)
    parts = [part for part in entry.get("anyOf", [entry]) if "properties" in part]
    return parts[0] if parts else None


def _default(entry: Schema) -> str:
    value = entry.get("default")
    if value in (None, "", [], {}) or isinstance(value, dict):
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _kind_of(entry: Schema, schema: Schema) -> str:
    """What a value may be, in words."""
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        return "column" if name.endswith("ColumnTable") else "table"
    if "enum" in entry:
        return " or ".join(f"`{word}`" for word in entry["enum"])
    if "anyOf" in entry:
        kinds = [_kind_of(part, schema) for part in entry["anyOf"] if part.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    kind = entry.get("type", "any")
    if kind == "array":
        return f"list of {_kind_of(entry.get('items', {}), schema)}"
    if kind == "object":
        inner = entry.get("additionalProperties")
        return f"names to {_kind_of(inner, schema)}" if isinstance(inner, dict) else "table"
    words = {"string": "text", "integer": "whole number", "boolean": "true or false"}
    plain = " or ".join(words.get(k, k) for k in ([kind] if isinstance(kind, str) else kind))
    bounds = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤"}
    return " ".join(
        [plain, *(f"{sign} {entry[key]:g}" for key, sign in bounds.items() if key in entry)]
    )


def _escaped(text: str) -> str:
    """Text for a cell: one line, names in single marks, mathematics between dollars."""
    text = re.sub(r":\w+:`([^`]*)`", r"$\1$", " ".join(text.split()))
    return text.replace("``", "`").replace("|", r"\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
