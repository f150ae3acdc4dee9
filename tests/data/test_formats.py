"""Files of recorders, simulators and spreadsheets: names, units, and the time they bring along."""

import struct
import sys

import numpy as np
import pytest
import scipy.io
import scipy.io.wavfile

from backsight.data import list_columns, read
from backsight.errors import DataError

N = 40
T = np.arange(N) * 0.5e-3
A, B = np.sin(np.arange(N)), np.arange(N) * 2.0


def write_lvm(path):
    rows = "".join(
        f"{round(t, 3)},{float(a)!r},{float(b)!r},\n" for t, a, b in zip(T, A, B, strict=True)
    )
    path.write_text(
        "LabVIEW Measurement,\nWriter_Version,2\nSeparator,Comma\nDecimal_Separator,.\n"
        "X_Columns,One\nDate,2023/05/05\n***End_of_Header***,\n,\nChannels,2,,,\n"
        "Samples,40,40,,\nY_Unit_Label,V,m,,\nX0,0.0E+0,0.0E+0,,\nDelta_X,5.0E-4,5.0E-4,,\n"
        "***End_of_Header***,,,\nX_Value,a,b,Comment\n" + rows
    )


def write_tdms(path):
    nptdms = pytest.importorskip("nptdms")
    more = {"wf_increment": 0.5e-3, "wf_start_offset": 0.0}
    a = nptdms.ChannelObject("g", "a", A, properties={"unit_string": "V", **more})
    b = nptdms.ChannelObject("g", "b", B, properties={"unit_string": "m", **more})
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([a, b])


def write_uff(path):
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(path))
    for k, (name, values, unit) in enumerate((("a", A, "V"), ("b", B, "m"))):
        head = pyuff.prepare_58(
            binary=0,
            func_type=1,
            rsp_node=k,
            rsp_dir=1,
            ref_node=0,
            ref_dir=0,
            data=values,
            x=T,
            id1=name,
            rsp_ent_name=f"p{k}",
            ref_ent_name="NONE",
            abscissa_spacing=1,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=12,
            ordinate_axis_units_lab=unit,
            orddenom_spec_data_type=0,
        )
        file.write_sets(head, "add")


def write_outb(path):
    scale, offset = np.array([1e4, 100.0]), np.array([0.0, 1.0])
    packed = np.round(np.c_[A, B] * scale + offset).astype("<i2")
    text = b"".join(f"{n:<10}".encode() for n in ("Time", "a", "b", "(s)", "(V)", "(m)"))
    path.write_bytes(
        struct.pack("<hiidd", 2, 2, N, 0.0, 0.5e-3)
        + scale.astype("<f4").tobytes()
        + offset.astype("<f4").tobytes()
        + struct.pack("<i", 4)
        + b"test"
        + text
        + packed.tobytes()
    )


WRITERS = {
    "r.lvm": write_lvm,
    "r.tdms": write_tdms,
    "r.uff": write_uff,
    "r.outb": write_outb,
}


@pytest.mark.parametrize("name", WRITERS)
def test_recorders_bring_their_time_and_units(tmp_path, name):
    WRITERS[name](tmp_path / name)
    r = read(tmp_path / name, inputs={"u": "b"}, outputs={"y": "a"})
    np.testing.assert_allclose(r.time, T, atol=1e-12)
    np.testing.assert_allclose(r.y[:, 0], A, atol=1e-4)
    np.testing.assert_allclose(r.u[:, 0], B, atol=1e-2)
    assert (r.output_unit.item(), r.input_unit.item()) == ("V", "m")
    with pytest.raises(DataError, match=r"by their time the samples are 0\.0005 s apart"):
        read(tmp_path / name, inputs={}, outputs={"y": "a"}, dt=0.1)
    with pytest.raises(DataError, match="no column 'acc'"):
        read(tmp_path / name, inputs={}, outputs={"y": "acc"})


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("part", [0.3, 0.9])
def test_cut_off_files_are_one_clear_line(tmp_path, name, part):
    path = tmp_path / name
    WRITERS[name](path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    said = ""
    try:
        r = read(path, inputs={}, outputs={"y": "a"})
        # A recording that was stopped is as long as it is; its last number may be cut.
        np.testing.assert_allclose(r.y[:-1, 0], A[: r.sizes["time"] - 1], atol=1e-4)
    except DataError as error:
        said = str(error)
    assert not said or (str(path) in said and "\n" not in said)


def test_channels_of_other_rates_are_not_mixed(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    a = nptdms.ChannelObject("g", "a", A, properties={"wf_increment": 1e-3})
    b = nptdms.ChannelObject("g", "b", B, properties={"wf_increment": 2e-3})
    with nptdms.TdmsWriter(tmp_path / "r.tdms") as writer:
        writer.write_segment([a, b])
    with pytest.raises(DataError, match=r"'a' has a sample every 0.001 s .* 'b' every 0.002 s"):
        read(tmp_path / "r.tdms", inputs={}, outputs={"a": "a", "b": "b"})


def test_sounds(tmp_path):
    counts = np.c_[np.arange(N), -np.arange(N)].astype(np.int16)
    scipy.io.wavfile.write(tmp_path / "r.wav", 8000, counts)
    r = read(tmp_path / "r.wav", inputs={}, outputs={"a": "0", "b": "data[1]"})
    np.testing.assert_array_equal(r.y, counts)
    assert r.attrs["dt"] == pytest.approx(1 / 8000)


@pytest.mark.parametrize("name", ["r.parquet", "r.feather"])
def test_tables_of_arrow(tmp_path, name):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import feather, parquet

    stamps = np.datetime64("2026-01-01", "ns") + (np.arange(N) * 500_000).astype("timedelta64[ns]")
    table = arrow.table({"t": stamps, "a": A, "n": ["x"] * N, "b": np.arange(N)})
    write = parquet.write_table if name == "r.parquet" else feather.write_feather
    write(table, tmp_path / name)
    r = read(tmp_path / name, inputs={"u": "b"}, outputs={"y": "a"}, time="t")
    np.testing.assert_allclose(r.time, T, atol=1e-12)
    np.testing.assert_array_equal(r.y[:, 0], A)
    with pytest.raises(DataError, match="'n' is not a column of real numbers"):
        read(tmp_path / name, inputs={}, outputs={"y": "n"}, time="t")


def test_spreadsheets(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    for row in [["Test of today"], [], ["t", "a", "note"], ["s", "kN", None]]:
        sheet.append(row)
    for t, a in zip(T, A, strict=True):
        sheet.append([float(t), float(a), "x"])
    other = book.create_sheet("Run 2")
    other.append(["t", "a"])
    for k in range(3):
        other.append([k, 10 * k])
    book.save(tmp_path / "r.xlsx")
    r = read(tmp_path / "r.xlsx", inputs={}, outputs={"y": "a"}, time="t")
    np.testing.assert_allclose(r.y[:, 0], A, rtol=1e-15)
    assert r.output_unit.item() == "kN"
    r = read(tmp_path / "r.xlsx", inputs={}, outputs={"y": "Run 2/a"}, time="Run 2/t")
    np.testing.assert_array_equal(r.y[:, 0], [0, 10, 20])


def test_a_library_that_is_missing_is_named(tmp_path, monkeypatch):
    (tmp_path / "r.parquet").write_bytes(b"PAR1" + bytes(20))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(DataError, match=r"library pyarrow .* pip install 'backsight\[formats\]'"):
        read(tmp_path / "r.parquet", inputs={}, outputs={"y": "a"}, dt=1.0)


def write_matrix(path, matrix, **more):
    if path.suffix == ".npy":
        np.save(path, matrix)
    elif path.suffix == ".npz":
        np.savez(path, data=matrix, **more)
    else:
        scipy.io.savemat(path, {"data": matrix, **more})


MATRIX = np.arange(3000.0).reshape(3, 1000)


@pytest.mark.parametrize("name", ["r.npy", "r.npz", "r.mat"])
def test_the_axis_of_time_is_seen_or_said(tmp_path, name):
    path = tmp_path / name
    asked = {"inputs": {}, "outputs": {"y": "data[2]"}, "dt": 1.0}
    for matrix in (MATRIX, MATRIX.T):
        write_matrix(path, matrix)
        np.testing.assert_array_equal(read(path, **asked).y[:, 0], MATRIX[2])
    write_matrix(path, MATRIX[:, :8])
    with pytest.raises(DataError, match=r"shape \(3, 8\).*not plain which axis is time; say axis"):
        read(path, **asked)
    np.testing.assert_array_equal(read(path, axis=1, **asked).y[:, 0], MATRIX[2, :8])
    np.testing.assert_array_equal(read(path, axis=0, **asked).y[:, 0], MATRIX[:, 2])
    with pytest.raises(DataError, match="axis"):
        read(path, axis=2, **asked)


def test_other_columns_say_which_axis_is_time(tmp_path):
    path = tmp_path / "r.npz"
    asked = {"inputs": {}, "outputs": {"y": "data[2]"}}
    write_matrix(path, MATRIX[:, :8], t=np.arange(8.0))
    np.testing.assert_array_equal(read(path, time="t", **asked).y[:, 0], MATRIX[2, :8])
    write_matrix(path, MATRIX[:, :3], t=np.arange(3.0))
    with pytest.raises(DataError, match="not plain which axis"):
        read(path, time="t", **asked)


def test_cells_and_arrays_of_structures_of_matlab(tmp_path):
    cells = np.empty(2, object)
    cells[:] = [A, B]
    channels = np.array([(A, 1.0), (B, 2.0)], [("values", object), ("fs", object)])
    signals = {"time": T, "signals": {"values": np.c_[A, B]}}  # Simulink's structure with time
    scipy.io.savemat(tmp_path / "r.mat", {"c": cells, "ch": channels, "out": signals})
    for names in (("c{1}", "ch(2).values"), ("c[0]", "ch[1]/values")):
        r = read(tmp_path / "r.mat", inputs={}, outputs=dict(zip("ab", names, strict=True)), dt=1.0)
        np.testing.assert_array_equal(r.y, np.c_[A, B])
    for name in ("out/signals/values[1]", "out.signals.values[1]", "out.signals.values(:,2)"):
        r = read(tmp_path / "r.mat", inputs={}, outputs={"b": name}, time="out.time")
        np.testing.assert_array_equal(r.y[:, 0], B)


def test_tables_in_hdf5(tmp_path):
    import h5py

    table = np.array(list(zip(T, A, strict=True)), [("t", "f8"), ("a", "f8")])
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["run/d"] = table
    r = read(tmp_path / "r.h5", inputs={}, outputs={"y": "run/d/a"}, time="run/d/t")
    np.testing.assert_array_equal(r.y[:, 0], A)
    with pytest.raises(DataError, match="a table: take a column as 'run/d/t'"):
        read(tmp_path / "r.h5", inputs={}, outputs={"y": "run/d"}, dt=1.0)


def test_a_gap_stays_a_gap_when_it_is_resampled(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("t,y\n" + "".join(f"{k * 0.1:.1f},{k}\n" for k in [0, 1, 2, 3, 13, 14, 15]))
    r = read(path, inputs={}, outputs={"y": "y"}, time="t", resample=0.1)
    assert np.isnan(r.y[4:13]).all()
    assert not np.isnan(r.y[:4]).any()
    assert not np.isnan(r.y[13:]).any()
    r = read(path, inputs={"u": "y"}, outputs={"y": "y"}, time="t", resample=0.1)
    assert "inputs go along a line through 9 samples in gaps" in r.attrs["understood"]


@pytest.mark.parametrize("name", WRITERS)
def test_the_columns_of_every_recorder_are_listed(tmp_path, name):
    WRITERS[name](tmp_path / name)
    found = list_columns(tmp_path / name)
    assert {"a", "b"} <= {c.name.rpartition("/")[2] for c in found.signals}
    assert found.dt == pytest.approx(0.5e-3)
    assert {c.unit for c in found.signals} == {"V", "m"}
