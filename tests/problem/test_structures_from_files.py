"""A finite-element model in files: matrices, tables of sensors and forces, modes."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sparse
from tests.models.finite_elements import beam_matrices

from backsight.errors import ProblemError
from backsight.models.lti import state_space
from backsight.models.structures import modal, reduced
from backsight.problem import load

PROBLEM = """
[recording]
path = "beam.csv"
dt = 0.001
outputs = { tip = "tip", a = "a" }
[model]
kind = "reduced"
mass = { path = "model.mat", name = "M" }
stiffness = "k.mtx"
modes = 3
rayleigh = [0.1, 1e-5]
fixed = ["1:UY", "1:RZ"]
coordinates = [%s]
residual = "feedthrough"
sensors = "sensors.csv"
forces = "forces.csv"
[estimate.F]
start = 0.0
sigma = 2.0
walk = 0.1
[noise]
sigma_w = { q1_dot = 1e-5 }
[prior]
sigma_x0 = { q1 = 1e-3, q2 = 1e-3, q3 = 1e-3, q1_dot = 1e-3, q2_dot = 1e-3, q3_dot = 1e-3 }
[estimators.KF]
kind = "kf"
"""
NAMES = [f"{i // 2 + 1}:{'RZ' if i % 2 else 'UY'}" for i in range(22)]
SENSORS = (
    "name,node,direction,kind,unit,noise\ntip,11,UY,displacement,m,1e-5\n"
    "a,6,-UY,acceleration,m/s2,0.02\n"
)


@pytest.fixture
def folder(tmp_path):
    M, K = beam_matrices(10, free=True)
    scipy.io.savemat(tmp_path / "model.mat", {"M": sparse.csc_matrix(M), "K": K})
    scipy.io.mmwrite(tmp_path / "k.mtx", sparse.coo_array(K), symmetry="symmetric", precision=16)
    (tmp_path / "sensors.csv").write_text(SENSORS)
    (tmp_path / "forces.csv").write_text("name,node,direction\nF,11,UY\n")
    names = ", ".join(f'"{name}"' for name in NAMES)
    (tmp_path / "p.toml").write_text(PROBLEM % names)
    return tmp_path


def changed(folder, old, new):
    path = folder / "p.toml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    return path


def test_all_of_it_in_files(folder):
    problem = load(folder / "p.toml")
    M, K = beam_matrices(10, free=True)
    expected = reduced(
        M, K, modes=3, rayleigh=(0.1, 1e-5), fixed=[0, 1], residual="feedthrough",
        sensors={"tip": ("displacement", 20), "a": ("acceleration", {10: -1.0})},
        inputs={"F": 20},
    )  # fmt: skip
    A, _, C, _ = state_space(problem.model)
    a, b, c, d = state_space(expected)
    np.testing.assert_allclose(A[:6], np.hstack([a, b]), rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(C, np.hstack([c, d]), rtol=1e-8, atol=1e-12)
    noise = problem.estimators["KF"].noise
    np.testing.assert_allclose(np.sqrt(np.diag(noise.measurement(problem.model))), [1e-5, 0.02])


def test_the_problem_file_has_the_last_word_on_noise(folder):
    problem = load(changed(folder, "[noise]", "[noise]\nsigma_y = { tip = 3e-5 }"))
    noise = problem.estimators["KF"].noise
    np.testing.assert_allclose(np.sqrt(np.diag(noise.measurement(problem.model))), [3e-5, 0.02])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("k.mtx", "k2.mtx", "model: there is no file '.*k2.mtx'"),
        ('name = "M"', 'name = "Mass"', "model: .* has no matrix 'Mass': known: K, M"),
        ("sensors.csv", "list.csv", "model.sensors: there is no file"),
        ("forces.csv", "p.toml", r"model.forces: .*p\.toml"),
        ('name = "M"', 'format = "excel"', "format"),
        ('"1:RZ"]\nc', '"1:RX"]\nc', "fixed is at the coordinate '1:RX': did you mean '1:RZ'"),
        ("[0.1, 1e-5]", "[0.1]", "model.rayleigh"),
    ],
)
def test_what_is_wrong_is_said(old, new, message, folder):
    with pytest.raises(ProblemError, match=message):
        load(changed(folder, old, new))


def test_another_unit_is_refused(folder):
    (folder / "sensors.csv").write_text(SENSORS.replace(",m,", ",mm,"))
    with pytest.raises(ProblemError, match="'tip' is in mm, but the model gives it in m; write m"):
        load(folder / "p.toml")


def test_modes_in_a_file(folder):
    (folder / "modes.csv").write_text(
        "mode,1,2\nfrequency,12.1,75.8\ndamping,0.01,0.02\nmodal mass,2,3\n"
        "tip,1,-1\nmiddle,0.4,0.7\n"
    )
    head, _, tail = (folder / "p.toml").read_text().partition("[model]")
    table = (
        '[model]\nkind = "modal"\nfrequencies = "modes.csv"\n'
        'sensors.tip = { kind = "displacement", at = "tip" }\n'
        'sensors.a = { kind = "acceleration", at = "middle" }\n'
        'forces = { F = "tip" }\n'
    )
    tail = tail[tail.index("[estimate.F]") :]
    tail = tail.replace(", q3 = 1e-3", "").replace(", q3_dot = 1e-3", "")
    tail = tail.replace("[noise]", "[noise]\nsigma_y = { tip = 1e-5, a = 0.1 }")
    (folder / "p.toml").write_text(head + table + tail)
    expected = modal(
        [12.1, 75.8], damping=[0.01, 0.02], modal_masses=[2, 3],
        sensors={"tip": ("displacement", [1, -1]), "a": ("acceleration", [0.4, 0.7])},
        inputs={"F": [1, -1]},
    )  # fmt: skip
    a, b, *_ = state_space(expected)
    np.testing.assert_allclose(state_space(load(folder / "p.toml").model)[0][:4], np.hstack([a, b]))


def test_a_state_space_in_a_file(tmp_path):
    """As model reduction benchmarks come: sparse A, B, C in one MAT file."""
    A = np.array([[0.0, 1.0], [-100.0, -0.5]])
    scipy.io.savemat(
        tmp_path / "build.mat",
        {"A": sparse.csc_matrix(A), "B": np.array([[0.0], [1.0]]), "C": np.array([[1.0, 0.0]])},
    )
    entries = "\n".join(f'{k} = {{ path = "build.mat", name = "{k}" }}' for k in "ABC")
    (tmp_path / "p.toml").write_text(
        '[recording]\npath = "x.csv"\ndt = 0.01\ninputs.u = "u"\noutputs.y = "y"\n'
        f'[model]\nkind = "lti"\n{entries}\nstates = {{ x = "", v = "" }}\n'
        "[noise]\nsigma_y = { y = 0.1 }\nsigma_w = { v = 0.1 }\n"
        '[prior]\nsigma_x0 = { x = 1.0, v = 1.0 }\n[estimators.KF]\nkind = "kf"\n'
    )
    np.testing.assert_array_equal(state_space(load(tmp_path / "p.toml").model)[0], A)
