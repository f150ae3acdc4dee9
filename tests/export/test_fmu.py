"""FMUs: valid, the same as Python, and their state can be kept."""

import dataclasses
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.errors import EngineError, OutputError
from backsight.estimators import EKF
from backsight.export import export_fmu
from backsight.testing import CASES, TrialProblem

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from lxml import etree  # noqa: E402
from tests.export.fmus import agrees, expected, instance, recorded, tunable_ekf, walk  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc")

LARGEST = 300_000  # bytes


@pytest.mark.parametrize(
    ("key", "hold"),
    [("ekf", "foh"), ("mhe", "zoh"), ("csmhe", "zoh"), ("joint_input", "zoh"), ("ahg", "zoh")],
)
def test_fmu_equals_python(key, hold, tmp_path, monkeypatch):
    if key == "csmhe":  # whose tables are beside its code, as large ones are
        monkeypatch.setattr("backsight.export.fmi.fmu.MOST", 0)
        monkeypatch.setattr("backsight.engine.c99.source.LARGE", 16)
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 2, hold))
    recording = recorded(problem, hold)
    file = export_fmu(estimator, problem.model, recording, tmp_path / f"{key}.fmu", name=key)
    assert validate_fmu(str(file)) == []
    assert file.stat().st_size <= LARGEST
    agrees(file, estimator, problem.model, recording)
    with zipfile.ZipFile(file) as archive:
        tables = [i.file_size for i in archive.infolist() if i.filename.startswith("resources/")]
    assert bool(tables) == (key == "csmhe")
    if tables:
        assert tables[0] % 8 == 0
        for damage in (without_tables, with_half_of_the_tables):
            with pytest.raises(Exception, match="instantiate"), instance(damage(file)):
                pass


def without_tables(file):
    """A copy of an FMU without its tables."""
    target = file.with_name("without.fmu")
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            if not entry.filename.startswith("resources/"):
                new.writestr(entry, old.read(entry))
    return target


def with_half_of_the_tables(file):
    """A copy of an FMU whose tables are cut off."""
    target = without_tables(file)
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(target, "a") as new:
        new.writestr("resources/tables.bin", old.read("resources/tables.bin")[:-8])
    return target


@pytest.fixture(scope="module")
def ekf(tmp_path_factory):
    return tunable_ekf(tmp_path_factory.mktemp("fmu"))


def test_outliers_do_not_count(ekf):
    file, estimator, model, recording = ekf
    agrees(file, estimator, model, recording)
    assert np.isfinite(expected(estimator, model, recording)["nis"]).sum() > 30


def test_going_back_gives_the_same_bits(ekf):
    file, _, _, recording = ekf
    samples = list(zip(recording["u"].values[:, 0], recording["y"].values, strict=True))
    with instance(file) as (fmu, references):
        walk(fmu, references, samples[:20])
        kept = fmu.getFMUState()
        written = fmu.serializeFMUState(kept)
        once = walk(fmu, references, samples[20:], first=20)
        fmu.setFMUState(kept)
        again = walk(fmu, references, samples[20:], first=20)
        fmu.freeFMUState(kept)
        assert once == again
    # Another instance goes on from what was written down.
    with instance(file) as (fmu, references):
        state = fmu.deserializeFMUState(written)
        fmu.setFMUState(state)
        assert walk(fmu, references, samples[20:], first=20) == once
        fmu.freeFMUState(state)
        with pytest.raises(FMICallException):
            fmu.deserializeFMUState(b"x" * len(written))


def test_parameters_are_tunable(ekf):
    file, _, model, recording = ekf
    assert {"sigma_y.position", "parameter.b"} <= {
        v.name
        for v in fmpy.read_model_description(str(file)).modelVariables
        if v.variability == "tunable"
    }
    samples = list(zip(recording["u"].values[:, 0], recording["y"].values, strict=True))
    with instance(file) as (fmu, references):
        before = walk(fmu, references, samples)
    with instance(file) as (fmu, references):
        fmu.setFloat64([references["sigma_y.speed"], references["parameter.b"]], [0.3, 2.5])
        assert walk(fmu, references, samples)[2:] != before[2:]
        fmu.setFloat64([references["sigma_y.speed"]], [0.0])
        with pytest.raises(FMICallException):
            walk(fmu, references, samples[:1], first=len(samples))
    assert model.outputs[1].unit == "length/s"


@pytest.mark.slow
def test_prior_and_walks_are_parameters(tmp_path):
    """As a new export; the prior until the first step, the walks at any time."""
    problem = CASES["ekf"].problem
    scales = {"q": 0.05, "v": 0.5, "k": 40.0}
    model = dataclasses.replace(
        problem.model,
        states=tuple(dataclasses.replace(s, scale=scales[s.name]) for s in problem.model.states),
    )
    estimator = CASES["ekf"].build(problem, Integrator("rk4", 1))
    recording = recorded(problem)
    file = export_fmu(
        estimator, model, recording, tmp_path / "a.fmu", tunable=["sigma_w", "x0", "lower"]
    )
    assert validate_fmu(str(file)) == []
    prior = dataclasses.replace(estimator.prior, x0={"q": 0.02, "v": 0.1, "k": 119.0})
    noise = dataclasses.replace(estimator.noise, sigma_w={"q": 3e-3, "v": 2e-2})
    other = dataclasses.replace(estimator, prior=prior, noise=noise)
    wanted = expected(other, model, recording)
    described = {v.name: v for v in fmpy.read_model_description(str(file)).modelVariables}
    assert described["x0.q"].variability == "fixed"
    assert described["sigma_w.q"].variability == "tunable"
    assert described["lower.k"].variability == "tunable"
    walks = {"sigma_w.q": 3e-3, "sigma_w.v": 2e-2}
    with instance(file, {"x0.q": 0.02, "x0.v": 0.1, "x0.k": 119.0, **walks}) as (fmu, at):
        assert fmu.getFloat64([at["x_hat.q"], at["x_hat.k"]]) == [0.02, 119.0]
        samples = zip(recording["u"].values[:, 0], recording["y"].values, strict=True)
        found = []
        for k, (u, y) in enumerate(samples):
            fmu.setFloat64([at[n] for n in ("u.F", "y.position", "y.speed")], [u, *y])
            fmu.doStep(currentCommunicationPoint=k * 0.02, communicationStepSize=0.02)
            found.append(fmu.getFloat64([at["x_hat.q"], at["x_hat.k"]]))
        with pytest.raises(FMICallException):
            fmu.setFloat64([at["x0.q"]], [0.0])
    for column, name in zip(np.array(found).T, ("x_hat.q", "x_hat.k"), strict=True):
        np.testing.assert_allclose(column, wanted[name], rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"), [("u.F", np.nan), ("y.speed", np.inf), ("mask.speed", -1.0)]
)
def test_bad_samples_are_refused_and_change_nothing(ekf, name, value):
    file, _, _, recording = ekf
    samples = list(zip(recording["u"].values[:, 0], recording["y"].values, strict=True))
    with instance(file) as (fmu, references):
        wanted = walk(fmu, references, samples[:5])
    with instance(file) as (fmu, references):
        walk(fmu, references, samples[:4])
        good = fmu.getFloat64([references[name]])
        fmu.setFloat64([references[name]], [value])
        with pytest.raises(FMICallException):
            fmu.doStep(currentCommunicationPoint=4 * 0.02, communicationStepSize=0.02)
        fmu.setFloat64([references[name]], good)
        for point, step in ((0.08, 0.01), (0.04, 0.02)):
            with pytest.raises(FMICallException):
                fmu.doStep(currentCommunicationPoint=point, communicationStepSize=step)
        assert walk(fmu, references, samples[4:5], first=4) == wanted[4:5]


def test_what_is_inside(ekf, tmp_path):
    file = ekf[0]
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path)
    for name in ("documentation/index.html", "terminalsAndIcons/icon.png", "sources/fmu.c"):
        assert name in names
    page = (tmp_path / "documentation/index.html").read_text()
    assert "One communication step is one sample, every 0.02 s" in page
    assert "sigma_y.position" in page
    schemas = Path(fmpy.__file__).parent / "schema" / "fmi3"
    for path, schema in (
        ("sources/buildDescription.xml", "fmi3BuildDescription.xsd"),
        ("terminalsAndIcons/terminalsAndIcons.xml", "fmi3TerminalsAndIcons.xsd"),
    ):
        etree.XMLSchema(etree.parse(schemas / schema)).assertValid(etree.parse(tmp_path / path))


def test_declarations_are_those_of_the_standard(ekf, tmp_path):
    with zipfile.ZipFile(ekf[0]) as archive:
        archive.extractall(tmp_path)
    headers = Path(fmpy.__file__).parent / "c-code"
    standard = ["-I", str(headers), "-include", "fmi3Functions.h"]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-fsyntax-only"]
    command = ["cc", *strict, *standard, str(tmp_path / "sources/fmu.c")]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    declared = set(
        re.findall(
            r"^#define (fmi3[A-Z]\w+) +fmi3FullName",
            (headers / "fmi3Functions.h").read_text(),
            re.M,
        )
    )
    library = next((tmp_path / "binaries").rglob("*.so"))
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", library], capture_output=True, text=True
    )
    exported = {line.split()[-1] for line in symbols.stdout.splitlines()}
    assert declared
    assert declared == {n for n in exported if n.startswith("fmi3")}
    assert exported == declared  # nothing else is visible


def test_units_are_told(tmp_path):
    problem = TrialProblem()
    model = dataclasses.replace(
        problem.model,
        outputs=tuple(
            dataclasses.replace(s, unit=u)
            for s, u in zip(problem.model.outputs, ("mm", "mm/s"), strict=True)
        ),
    )
    file = export_fmu(
        EKF(problem.noise, problem.prior, Integrator("rk4", 1)),
        model,
        recorded(problem).assign_coords(output_unit=("output", ["mm", "mm/s"])),
        tmp_path / "a.fmu",
        platforms=[],
    )
    units = {u.name: u.baseUnit for u in fmpy.read_model_description(str(file)).unitDefinitions}
    assert (units["mm/s"].m, units["mm/s"].s, units["mm/s"].factor) == (1, -1, 1e-3)
    assert units["length"] is None


def test_what_cannot_be_is_refused(tmp_path):
    problem = TrialProblem()
    arguments = EKF(problem.noise, problem.prior), problem.model, recorded(problem)
    with pytest.raises(OutputError, match=r"ends with \.fmu"):
        export_fmu(*arguments, tmp_path / "ekf.zip")
    with pytest.raises(EngineError, match="'state' is the name of a file"):
        export_fmu(*arguments, tmp_path / "ekf.fmu", name="state")
    with pytest.raises(EngineError, match="amiga"):
        export_fmu(*arguments, tmp_path / "ekf.fmu", platforms=["m68k-amiga"])
    foreign = tmp_path / "foreign.fmu"
    foreign.write_bytes(b"mine")
    with pytest.raises(OutputError, match="is not from here"):
        export_fmu(*arguments, foreign, platforms=[])
    assert foreign.read_bytes() == b"mine"
    export_fmu(*arguments, foreign, platforms=[], force=True)
    export_fmu(*arguments, foreign, platforms=[])  # its own
    assert not (tmp_path / "ekf.fmu").exists()
