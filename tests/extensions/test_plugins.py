"""What other distributions bring is known without importing it, and cannot take ours down."""

import subprocess
import sys

import pytest

import backsight as bs
import small_problem
from backsight.data.formats.loading import READERS
from backsight.errors import BacksightError, PluginError, ProblemError
from backsight.estimators import ALL_ESTIMATORS, EKF, ESTIMATORS
from backsight.problem import load
from backsight.studies import studies
from extensions.distributions import install

OWN_EKF = """
import dataclasses
from backsight.estimators import EKF

@dataclasses.dataclass(frozen=True)
class Mine(EKF):
    key = "{key}"
    title = "My filter"
"""


@pytest.fixture
def add(tmp_path, monkeypatch):
    """``add(name, modules, group={...})``: a distribution that is installed during a test."""

    def add(name, modules, **entry_points):
        folder = tmp_path / f"site-{name}"
        install(folder, name, modules, **entry_points)
        monkeypatch.syspath_prepend(str(folder))
        for module in modules:
            monkeypatch.delitem(sys.modules, module, raising=False)

    yield add
    for module in [m for m in sys.modules if m.startswith("outside_")]:
        del sys.modules[module]


def problem(folder, kind: str):
    path = small_problem.write(folder)
    text = path.read_text(encoding="utf-8").replace('kind = "ekf"', f'kind = "{kind}"')
    path.write_text(text, encoding="utf-8")
    return path


def test_ours_are_there_without_any():
    assert set(ESTIMATORS) <= set(ALL_ESTIMATORS)
    assert ALL_ESTIMATORS["ekf"] is EKF
    assert ALL_ESTIMATORS.maker("ekf") is None
    assert "no such" not in ALL_ESTIMATORS
    with pytest.raises(KeyError):
        ALL_ESTIMATORS["no such"]


def test_an_estimator_is_known_before_it_is_imported(add, tmp_path):
    add("others", {"outside_a": OWN_EKF.format(key="mine")}, estimators={"mine": "outside_a:Mine"})
    assert "mine" in list(ALL_ESTIMATORS)
    assert "outside_a" not in sys.modules
    assert load(problem(tmp_path, "mine")).estimators["EKF"].title == "My filter"
    assert ALL_ESTIMATORS.maker("mine") == "others 0.1"


def test_it_is_listed_with_its_maker_and_misspelled_ones_are_told(add, backsight, tmp_path):
    add("others", {"outside_a": OWN_EKF.format(key="mine")}, estimators={"mine": "outside_a:Mine"})
    _, printed, told = backsight("methods")
    assert '# My filter (from others 0.1)\nkind = "mine"\n' in printed
    assert told == ""
    with pytest.raises(ProblemError, match="unknown kind 'mime', did you mean 'mine'"):
        load(problem(tmp_path, "mime"))
    with pytest.raises(ProblemError) as error:
        load(problem(tmp_path, "hinfinity"))
    assert str(error.value).endswith(
        "; if an extension brings 'hinfinity' (entry points 'backsight.estimators'), pip install it"
    )


BROKEN = {
    "import nothing_of_this_name": "ModuleNotFoundError: No module named 'nothing_of_this_name'",
    "raise SystemExit('bye')": "SystemExit: bye",
    "1 / 0": "ZeroDivisionError: division by zero",
    "x = 1": "AttributeError: module 'outside_a' has no attribute 'Mine'",
    "Mine = 3": "3 is not a subclass of AbstractEstimator",
    "from backsight.estimators import EKF as Mine": "EKF.key must be 'mine'",
    "from backsight.estimators import AbstractEstimator as Mine": "has no method 'build'",
}


@pytest.mark.parametrize("source", BROKEN)
def test_a_broken_one_is_a_sentence_and_the_rest_goes_on(add, backsight, tmp_path, source):
    add("others", {"outside_a": source}, estimators={"mine": "outside_a:Mine"})
    path = problem(tmp_path, "mine")
    code, printed, told = backsight("run", path, "-o", tmp_path / "out")
    assert (code, printed) == (2, "")
    assert told.count("\n") == 1
    assert "estimators.EKF.kind: the estimator 'mine' of others 0.1 " in told
    assert BROKEN[source] in told
    code, printed, told = backsight("methods")
    assert code == 0
    assert 'kind = "ekf"' in printed
    assert "mine" not in printed
    assert told.count("\n") == 1
    assert BROKEN[source] in told
    assert bs.errors.PluginError is PluginError


def test_one_with_a_key_of_ours_is_refused_by_both_names(add, backsight, tmp_path):
    add("others", {"outside_a": OWN_EKF.format(key="ekf")}, estimators={"ekf": "outside_a:Mine"})
    assert ALL_ESTIMATORS["ekf"] is EKF
    expected = (
        "backsight: warning: the estimator 'ekf' of others 0.1 is not used: 'ekf' is backsight's "
        "EKF; it needs another key\n"
    )
    assert backsight("methods")[2] == expected
    code, _, told = backsight("run", small_problem.write(tmp_path), "-o", tmp_path / "out")
    assert (code, told) == (0, expected)


def test_two_with_the_same_key_are_refused_by_both_names(add, tmp_path):
    for name in ("others", "more"):
        module = f"outside_{name}"
        source = OWN_EKF.format(key="mine")
        add(name, {module: source}, estimators={"mine": f"{module}:Mine"})
    with pytest.raises(BacksightError, match=r"'mine' is brought by more 0.1 and by others 0.1"):
        load(problem(tmp_path, "mine"))


def test_an_estimator_that_fails_in_a_run_is_named(add, backsight, tmp_path):
    source = OWN_EKF.format(key="mine") + "    def build(self, model, dt):\n        return {}['q']"
    add("others", {"outside_a": source}, estimators={"mine": "outside_a:Mine"})
    code, _, told = backsight("run", problem(tmp_path, "mine"), "-o", tmp_path / "out")
    assert code == 2
    assert told == (
        "backsight: estimators.EKF: the estimator 'mine' of others 0.1 failed: KeyError: 'q'\n"
    )


MODEL = """
from backsight.models import Model
def tank(area: float, name: str = "tank") -> Model:
    return Model(f=lambda x, u, p: [u.q / p.area], h=lambda x, u, p: [x.z], states={"z": "m"},
                 inputs={"q": "m3/s"}, outputs={"y": "m"}, parameters={"area": area}, name=name)
def untyped(area): ...
def odd(area: 3): ...
def strange(area: Model): ...
def late(area: float): return 1 / 0
"""

TANK = """
[recording]
path = "a.csv"
dt = 0.1
inputs.q = "q"
outputs.y = "y"
[model]
kind = "tank"
area = 2.0
[noise]
sigma_y = { y = 0.1 }
[prior]
sigma_x0 = { z = 1.0 }
[estimators.EKF]
kind = "ekf"
"""


@pytest.fixture
def tank(add, tmp_path):
    def tank(function: str, text: str = TANK):
        add("tanks", {"outside_m": MODEL}, models={"tank": f"outside_m:{function}"})
        path = tmp_path / "tank.toml"
        path.write_text(text)
        return load(path)

    return tank


def test_a_model_is_a_function_with_types(tank):
    read = tank("tank")
    assert read.model.name == "tank"
    assert {s.name: s.value for s in read.model.parameters} == {"area": 2.0}


@pytest.mark.parametrize(
    ("function", "text", "message"),
    [
        ("tank", TANK.replace("area = 2.0", 'area = "wide"'), "model.area: must be a number"),
        ("tank", TANK.replace("area = 2.0", "aera = 2.0"), "model.aera: unknown key"),
        ("tank", TANK.replace("area = 2.0", ""), "model.area: is missing"),
        ("untyped", TANK, "'tank' of tanks 0.1 cannot be used: area: an argument needs a type"),
        ("odd", TANK, "cannot be used: an argument has a type that a file cannot give"),
        ("strange", TANK, "cannot be used: an argument has a type that a file cannot give"),
        ("late", TANK, "the model 'tank' of tanks 0.1 failed: ZeroDivisionError"),
    ],
)
def test_what_a_file_gives_a_model_is_checked(tank, function, text, message):
    with pytest.raises(BacksightError, match=message):
        tank(function, text)


READER = """
def read(path, wanted):
    rows = [line.split("|") for line in path.read_text().splitlines()]
    return {name: [float(v) for v in values] for name, *values in rows}
def nothing(path, wanted): return None
def fails(path, wanted): raise AssertionError("no head")
"""


@pytest.fixture
def pipe(add, tmp_path):
    def pipe(function: str, text: str = "u|1|2|3\ny|4|5|6\n"):
        add("pipes", {"outside_r": READER}, readers={"pipe": f"outside_r:{function}"})
        path = tmp_path / "a.PIPE"
        path.write_text(text)
        return bs.read(path, inputs={"u": "u"}, outputs={"y": "y"}, dt=0.1)

    return pipe


def test_a_reader_reads_what_it_is_for(pipe):
    recording = pipe("read")
    assert recording.u.values.ravel().tolist() == [1.0, 2.0, 3.0]
    assert recording.y.values.ravel().tolist() == [4.0, 5.0, 6.0]
    assert ".pipe" in list(READERS)


@pytest.mark.parametrize(
    ("function", "text", "message"),
    [
        ("read", "u|1|2\n", "there is no column 'y': known: u"),
        ("read", "u|1|b\ny|1|2", "cannot be read as a '.pipe' file: could not convert"),
        ("nothing", "", "returned no columns by name"),
        ("fails", "", "the reader '.pipe' of pipes 0.1 failed: AssertionError: no head"),
        ("absent", "", "the reader '.pipe' of pipes 0.1 cannot be loaded"),
    ],
)
def test_a_reader_that_fails(pipe, function, text, message):
    with pytest.raises(BacksightError, match=message.replace(".pipe", r"\.?pipe")):
        pipe(function, text)


STUDY = """
class Own:
    name, title, seeds = "{name}", "Own study", 2
    def run(self, out, *, seeds, recordings, progress): ...
STUDY = Own()
"""


def test_a_study_is_listed_beside_a_broken_one(add, backsight):
    add("good", {"outside_s": STUDY.format(name="own")}, studies={"own": "outside_s:STUDY"})
    add("bad", {"outside_t": "1 / 0"}, studies={"other": "outside_t:STUDY"})
    code, printed, told = backsight("study", "list")
    assert code == 0
    assert "own: Own study\n" in printed
    assert "nanopositioner: " in printed
    assert told.count("\n") == 1
    assert "the study 'other' of bad 0.1 cannot be loaded" in told


def test_two_studies_of_one_name_and_what_is_no_study(add):
    add("a", {"outside_s": STUDY.format(name="own")}, studies={"own": "outside_s:STUDY"})
    add("b", {"outside_t": STUDY.format(name="own")}, studies={"own": "outside_t:STUDY"})
    add("c", {"outside_u": "STUDY = 3"}, studies={"three": "outside_u:STUDY"})
    told = []
    assert type(studies(tell=told.append)["own"]).__module__ == "outside_s"
    assert "the study 'own' of b 0.1 is not used: a 0.1 brings one of that name" in told
    assert any("of c 0.1 is no study: 3" in sentence for sentence in told)


def test_without_studies_it_says_where_they_are(backsight, monkeypatch, tmp_path):
    monkeypatch.setattr("backsight.studies.entry_points", lambda group: [])
    for command in (["list"], ["run", "beam", "-o", tmp_path]):
        code, printed, told = backsight("study", *command)
        assert (code, printed) == (2, "")
        assert told == "backsight: no studies are installed: pip install backsight-studies\n"


def test_the_package_never_imports_a_distribution_by_itself(tmp_path):
    install(tmp_path, "others", {"outside_a": "1 / 0"}, estimators={"mine": "outside_a:Mine"})
    code = "import sys, backsight as bs; bs.EKF; bs.read; assert 'outside_a' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": str(tmp_path)})
