import importlib.util
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "examples" / "stage"


def test_the_recording_that_ships_is_what_its_script_makes(tmp_path):
    spec = importlib.util.spec_from_file_location("make_recording", FOLDER / "make_recording.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    made = script.recording_text().splitlines()
    shipped = (FOLDER / "stage.csv").read_text(encoding="utf-8").splitlines()
    comments = len(script.HEADER.splitlines())
    assert made[: comments + 1] == shipped[: comments + 1]
    made_table, shipped_table = (
        np.array([[float(v) for v in line.split(",")] for line in lines[comments + 1 :]])
        for lines in (made, shipped)
    )
    assert shipped_table.shape == (4000, 8)
    np.testing.assert_allclose(made_table, shipped_table, rtol=2e-8, atol=1e-9)
