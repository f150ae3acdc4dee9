"""Modes and tables of sensors and forces, as modal tests and spreadsheets give them."""

import numpy as np
import pytest

from backsight.data import read_forces, read_modes, read_sensors
from backsight.data.finite_elements.modes import _in_phase
from backsight.errors import BacksightWarning, DataError


def test_modes_of_a_universal_file(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "modes.uff"
    file = pyuff.UFF(str(path))
    shapes = [[0.1, 0.7, 1.4], [-0.3, -1.1, 0.9]]
    for k, (frequency, shape) in enumerate(zip((12.1, 75.8), shapes, strict=True)):
        file.write_sets(
            {
                "type": 55, "model_type": 1, "analysis_type": 2, "data_ch": 2, "spec_data_type": 8,
                "data_type": 2, "n_data_per_node": 3, "n_int": 2, "n_real": 4, "load_case": 0,
                "mode_n": k + 1, "freq": frequency, "modal_m": 1.0,
                "modal_damp_vis": 0.01 * (k + 1), "modal_damp_his": 0.0, "node_nums": [1, 2, 7],
                "id1": "NONE", "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
                "r1": np.zeros(3), "r2": np.zeros(3), "r3": np.array(shape),
            },
            "add",
        )  # fmt: skip
    found = read_modes(path)
    np.testing.assert_allclose(found.frequencies, [12.1, 75.8])
    np.testing.assert_allclose(found.damping, [0.01, 0.02])
    np.testing.assert_allclose(found.modal_masses, [1.0, 1.0])
    np.testing.assert_allclose(found.at("7:UZ"), [1.4, 0.9])
    np.testing.assert_allclose(found.at({"7:UZ": 1, "2:UZ": -1}), [0.7, 2.0])
    with pytest.raises(DataError, match="there is no coordinate '3:UZ': did you mean"):
        found.at("3:UZ")


def test_modes_of_a_table(tmp_path):
    path = tmp_path / "modes.csv"
    path.write_text("mode;1;2\nFrequency [Hz];12,1;75,8\ndamping %;1;2\n1:UZ;0,7;1,4\n2:UZ;1;-1\n")
    found = read_modes(path)
    np.testing.assert_allclose(found.frequencies, [12.1, 75.8])
    np.testing.assert_allclose(found.damping, [0.01, 0.02])
    assert found.modal_masses is None
    np.testing.assert_allclose(found.at("2:UZ"), [1, -1])
    path.write_text("mode,1\n1:UZ,0.7\n")
    with pytest.raises(DataError, match="has no row 'frequency'"):
        read_modes(path)


def test_sensors_and_forces(tmp_path):
    path = tmp_path / "sensors.csv"
    path.write_text(
        "name;node;direction;kind;unit;noise;weight\n"
        "a;7;-Z;Acceleration;m/s2;0,02;\n"
        "tilt;7;UZ;displacement;m;1e-5;0,5\n"
        "tilt;9;3;displacement;;;-0,5\n"
    )
    found = read_sensors(path)
    assert found.sensors == {
        "a": ("acceleration", {"7:UZ": -1.0}),
        "tilt": ("displacement", {"7:UZ": 0.5, "9:UZ": -0.5}),
    }
    assert found.noise == {"a": 0.02, "tilt": 1e-5}
    assert found.units == {"a": "m/s2", "tilt": "m"}
    path.write_text("name,coordinate\nF,12:UX\nG,4\n")
    assert read_forces(path) == {"F": {"12:UX": 1.0}, "G": {4: 1.0}}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("name,kind\na,acceleration", "lacks coordinate"),
        ("name,coordinate\na,3", "lacks kind"),
        ("name,place,kind\na,3,acceleration", "has a column 'place': "),
        ("name,coordinate,node,kind\na,3,3,strain", "lacks one of coordinate and node"),
        (
            "name,node,direction,kind\na,3,UW,strain",
            "row 2: node '3' and direction 'UW' are no",
        ),
        ("name,coordinate,kind\n,3,strain", "row 2: name is empty"),
        ("name,coordinate,kind,noise\na,3,strain,loud", "row 2: noise is 'loud', not a number"),
        ("name,coordinate,kind\na,3,strain\na,3,strain", "row 3: 'a' is at 3 twice"),
        ("name,coordinate,kind\na,3,strain\na,4,velocity", "row 3: sensor 'a' is of two kinds"),
        ("name,coordinate,kind\na,3,strain,4", "row 2: 4 cells for 3 names"),
        ("name,coordinate,kind", "has no rows"),
    ],
)
def test_wrong_tables_are_said(content, message, tmp_path):
    path = tmp_path / "sensors.csv"
    path.write_text(content)
    with pytest.raises(DataError, match=message):
        read_sensors(path)


def test_complex_shapes_are_said(tmp_path):
    with pytest.warns(BacksightWarning, match="mode 2 is complex, 50 % of it out of phase"):
        found = _in_phase(np.array([[1.0, 1.0], [2.0, 1.0j / np.sqrt(3)]]), tmp_path)
    np.testing.assert_allclose(found[:, 0], [1, 2])
