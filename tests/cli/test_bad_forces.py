"""Structures and unknown forces that cannot be: one line each, or a remark beside the results."""

import json
import shutil
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "beam"


def changed(file, changes):
    """The problem file with passages replaced."""
    text = (EXAMPLE / file).read_text(encoding="utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
        text = text.replace(old, new)
    return text


BEAM, MATRICES = "problem.toml", "by_matrices.toml"
FOUR_MODES = {
    "modes = 3": "modes = 4",
    "damping = [0.030, 0.037, 0.119]": "damping = 0.03",
    "q3 = 1e-4": "q3 = 1e-4, q4 = 1e-4",
    "q1_dot = 1e-3": "q1_dot = 1e-3, q4_dot = 1e-3",
}
"""The fourth vibrates at 301 Hz, and Nyquist is at 200 Hz."""

WRONG_SIZE = 'dictionary = { kind = "Atoms", matrix = [[1.0], [1.0]] }\nlam = 29.434'


@pytest.mark.parametrize(
    ("file", "changes", "message"),
    [
        (BEAM, {"F8 = 0.405": "F8 = 0.5"}, "model: force 'F8' is at 0.5 m, off the beam, which"),
        (BEAM, {"F1 = 0.125": "F1 = 0.0"}, "model: force 'F1' at 0 m moves no mode"),
        (BEAM, {"at = 0.245": "at = 0.0"}, "model: sensor 'y1' at 0 m sees no mode"),
        (BEAM, {"at = 0.245": "at = -0.1"}, "model: sensor 'y1' is at -0.1 m, off the beam"),
        (BEAM, FOUR_MODES, "model: model 'beam' has modes that sampling every 0.0025 s cannot"),
        (
            BEAM,
            FOUR_MODES,
            "301.1 Hz (q4, q4_dot); the limit (Nyquist) is 200 Hz: keep fewer modes",
        ),
        (MATRICES, {"F4 = [1, 0, 0]": "F4 = [0, 0, 0]"}, "CS-MHE: force F4 moves no state of the"),
        (BEAM, {"lam = 29.434": WRONG_SIZE}, "CS-MHE: the dictionary has 2 rows; 8 forces need 8"),
        (
            BEAM,
            {"lam = 29.434": WRONG_SIZE.replace("Atoms", "Atom")},
            "estimators.CS-MHE.dictionary.kind: unknown kind 'Atom', did you mean 'Atoms'?",
        ),
        (
            BEAM,
            {"lam = 29.434": 'lam = 29.434\nnonnegative = ["F9"]'},
            "CS-MHE: 'F9' is none of the forces: ",
        ),
        (
            BEAM,
            {'["F1", "F2"': '["F1", "F9"'},
            "CS-MHE: forces: the model has no parameter 'F9': ",
        ),
        (BEAM, {"lam = 29.434": "lam = -1"}, "estimators.CS-MHE: lam is -1.0; it must be positive"),
        (BEAM, {"threshold = 0.5": "threshold = -0.5"}, "CS-MHE: threshold is -0.5; it must not"),
        (BEAM, {"drift = [100.0, 1000.0]": "drift = [100.0]"}, "drift is (100.0,); give two"),
    ],
)
def test_structures_and_forces_that_cannot_be(refused, tmp_path, file, changes, message):
    shutil.copy(EXAMPLE / "beam.csv", tmp_path)
    assert message in refused(changed(file, changes))


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        (
            {"lam = 29.434 ": "lam = 1e6 "},
            "no force was found in the whole recording: lam is at or above lambda_max = 1110; "
            "choose a smaller one",
        ),
        (
            {"threshold = 0.5": "threshold = 50.0"},
            "all forces that were found, up to 10.0, are below the threshold; lower it",
        ),
    ],
)
def test_settings_that_hide_all_forces_get_a_remark(backsight, tmp_path, changes, remark):
    text = changed(
        "problem.toml", changes | {'path = "beam.csv"': f"path = '{EXAMPLE / 'beam.csv'}'"}
    )
    cut = text.index('[estimators."three forces"]')
    path = tmp_path / "problem.toml"
    path.write_text(text[:cut], encoding="utf-8")
    code, printed, _ = backsight("run", path, "--out", tmp_path / "out")
    assert code == 0
    assert remark in " ".join(printed.split())
    written = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    entry = written["estimators"]["CS-MHE"]
    assert entry["hits"] == {"count": 0, "unit": "N", "largest": []}
    assert remark in entry["verdict"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count(remark) == 2  # in the verdict and where the map would be
    assert '"type":"heatmap"' not in page
