"""The JSON schema takes what is read, and refuses what is refused for its form."""

import importlib.util
import json
import tomllib
from pathlib import Path

import pytest

import small_problem
from backsight.errors import ProblemError
from backsight.problem.json_schema import json_schema
from backsight.problem.methods import methods
from backsight.problem.reading.loading import load

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(
    path
    for path in (ROOT / "examples").rglob("*.toml")
    # That of an extension has a kind of model that is not installed here.
    if "[recording]" in path.read_text(encoding="utf-8") and path.parent.name != "extension"
)


@pytest.fixture(scope="module")
def check():
    schema = json_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_every_example_keeps_to_it(check, path):
    given = tomllib.loads(path.read_text(encoding="utf-8"))
    assert [e.message for e in check.iter_errors(given)] == []


def test_the_settings_of_every_estimator_keep_to_it(check):
    """What `backsight methods` prints, one after the other, in a whole file."""
    given = tomllib.loads(small_problem.TEXT)
    for block in methods().split("\n\n"):
        settings = tomllib.loads(block.replace("= ...", "= 1"))
        for name in ("forces", "poles", "gain", "bandwidth"):
            if settings.get(name) == 1:
                settings[name] = [1.0] if name != "forces" else ["F"]
        if "kind" not in settings:
            continue
        given["estimators"] = {"own": settings}
        found = [e.message for e in check.iter_errors(given) if "is not of type" not in e.message]
        assert found == [], settings["kind"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('time = "t"', 'time = "t"\ntme = "t"'),
        ('time = "t"', "time = 1"),
        ('time = "t"', 'time = "t"\ndecimal = ";"'),
        ('kind = "sdof"', 'kind = "sdof"\nmass = "1"'),
        ('kind = "sdof"', 'kind = "sdoff"'),
        ("sigma = 30.0", 'sigma = "30"'),
        ("N = 5", "N = 5.5"),
        ("N = 5", "N = 0"),
        ("N = 5", "M = 5"),
        ('kind = "ekf"', 'kind = "efk"'),
        ('kind = "ekf"', 'kind = "ekf"\nsmooth = "yes"'),
        ("[noise]", '[noise]\noutliers = { kind = "Gaate" }'),
        ("[reference]", "[integrator]\nsubsteps = 0\n[reference]"),
        ('title = "Mass on a spring"', "title = 1"),
    ],
)
def test_faults_of_form_are_seen_by_both(check, tmp_path, old, new):
    text = small_problem.changed(old, new)
    assert list(check.iter_errors(tomllib.loads(text)))
    with pytest.raises(ProblemError):
        load(small_problem.write(tmp_path, text))


def test_sound_variants_are_taken_by_both(check, tmp_path):
    text = small_problem.changed(
        "[noise]", '[noise]\noutliers = { kind = "StudentT", nu = 4.0 }'
    ).replace('outputs.y = { column = "place", unit = "m" }', 'outputs.y = "place"')
    assert list(check.iter_errors(tomllib.loads(text))) == []
    load(small_problem.write(tmp_path, text))


def test_keys_say_what_they_are(check):
    branches = check.schema["properties"]["estimators"]["additionalProperties"]["allOf"]
    (mho,) = [b["then"] for b in branches if b["if"]["properties"]["kind"]["const"] == "mho"]
    assert mho["properties"]["N"]["description"]
    assert mho["properties"]["N"]["minimum"] == 1


def test_the_command_prints_it(capsys):
    from typer.testing import CliRunner

    from backsight.cli import app

    result = CliRunner().invoke(app, ["schema"], catch_exceptions=False)
    assert result.exit_code == 0
    assert json.loads(result.stdout) == json_schema()


def test_every_key_is_explained():
    """In the tables of the file, of models and of estimators."""
    schema = json_schema()
    tables = [schema["properties"]["model"], schema["properties"]["estimators"]]
    own = [b["then"] for t in (tables[0], tables[1]["additionalProperties"]) for b in t["allOf"]]
    keys = [
        (name, entry)
        for table in [schema, *own, *schema["definitions"].values()]
        for name, entry in table.get("properties", {}).items()
        if "const" not in entry
    ]
    assert len(keys) > 250
    inner = {"SensorTable", "MatrixTable", "ParameterTable"}
    assert inner <= set(schema["definitions"])
    small = {n for name in inner for n in schema["definitions"][name].get("properties", {})}
    assert not [n for n, entry in keys if not entry.get("description") and n not in small]


def test_the_page_of_all_keys_is_that_of_the_schema():
    found = importlib.util.spec_from_file_location("keys", ROOT / "docs" / "keys.py")
    assert found is not None
    assert found.loader is not None
    keys = importlib.util.module_from_spec(found)
    found.loader.exec_module(keys)
    assert keys.PAGE.read_text(encoding="utf-8") == keys.page(), "run docs/keys.py"
