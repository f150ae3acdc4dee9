"""Files of test benches and wind turbines, written by their libraries."""

import datetime

import numpy as np
import pytest

from backsight.data import list_columns, merge, read
from backsight.errors import DataError

N = 40
T = np.arange(N) * 0.5e-3
A, B = np.sin(np.arange(N)), np.arange(N) * 2.0


def write_mdf(path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime.datetime(2026, 3, 1, 10, tzinfo=datetime.UTC)
        signals = [("a", A, "V"), ("b", B, "m")]
        fast = [asammdf.Signal(v, T, name=n, unit=u) for n, v, u in signals]
        words = {"val_0": 0, "text_0": "P", "val_1": 1, "text_1": "R", "default": "N"}
        slow = [
            asammdf.Signal(B[:20], 2 * T[:20], name="a", unit="V"),
            asammdf.Signal(np.arange(20) % 3, 2 * T[:20], name="gear", conversion=words),
        ]
        file.append(fast, acq_name="fast")
        file.append(slow, acq_name="slow")
        file.save(path, overwrite=True)


def hawc2_head(form, factors=()):
    rows = [("Time", "s", "Time"), ("a", "V", "of the tower"), ("b", "m", "b of the blade")]
    rows += [("b", "m", "b of the hub")]
    lines = ["_" * 80, "  Version ID : HAWC2MB 13.1", "  Time : 10:00", "  Date : 1:3.2026"]
    lines += ["_" * 80, "  Result file : r.dat", "_" * 80, " Scans Channels Time [sec] Format"]
    lines += [f"  {N}  4  {N * 0.5e-3:.5f}  {form}", "", " Channel   Variable Description", ""]
    lines += [f"{k:8d}    {n:<31}{u:<11}{d}" for k, (n, u, d) in enumerate(rows, 1)]
    lines += ["_" * 80, "Scale factors:", *(f"{f:.5E}" for f in factors)]
    return "\n".join(lines) + "\n"


def write_hawc2_binary(path):
    """HAWC2 writes the first sample after one period; time is packed, too."""
    table = np.stack([T + 0.5e-3 + 10.0, A, B, -B])
    factors = np.abs(table).max(1) / 32000
    path.with_suffix(".sel").write_text(hawc2_head("BINARY", factors))
    packed = np.round(table / factors[:, None]).astype("<i2")
    path.with_suffix(".dat").write_bytes(packed.tobytes())


def write_hawc2_text(path):
    path.with_suffix(".sel").write_text(hawc2_head("ASCII"))
    np.savetxt(path.with_suffix(".dat"), np.c_[T + 0.5e-3 + 10.0, A, B, -B], "%14.7E")


@pytest.mark.parametrize("suffix", [".sel", ".dat"])
@pytest.mark.parametrize("write", [write_hawc2_binary, write_hawc2_text])
def test_results_of_hawc2(tmp_path, write, suffix):
    path = tmp_path / f"r{suffix}"
    write(path)
    r = read(path, inputs={"u": "b of the blade"}, outputs={"y": "a", "hub": "4"})
    np.testing.assert_allclose(r.time, T + 10.0005, atol=1e-12)
    np.testing.assert_allclose(r.y, np.c_[A, -B], atol=2e-3)
    np.testing.assert_allclose(r.u[:, 0], B, atol=2e-3)
    assert r.output_unit.values.tolist() == ["V", "m"]
    with pytest.raises(DataError, match="no column 'b'"):
        read(path, inputs={}, outputs={"y": "b"})
    found = list_columns(path)
    assert [c.name for c in found.signals] == ["a", "b of the blade", "b of the hub"]
    assert found.dt == pytest.approx(0.5e-3)


def test_results_of_hawc2_that_are_cut_off_or_lack_a_file(tmp_path):
    path = tmp_path / "r.dat"
    write_hawc2_binary(path)
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(DataError, match="318 bytes, but 40 samples of 4 channels are 320"):
        read(path, inputs={}, outputs={"y": "a"})
    path.unlink()
    with pytest.raises(DataError, match=r"two files; there is no '.*r\.dat'"):
        read(tmp_path / "r.sel", inputs={}, outputs={"y": "a"})
    sel = tmp_path / "r.sel"
    sel.write_text("\n".join(sel.read_text().splitlines()[:14]))
    with pytest.raises(DataError, match="cut off: 4 are told, 2 listed"):
        read(sel, inputs={}, outputs={"y": "a"})


def test_mdf(tmp_path):
    path = tmp_path / "r.mf4"
    write_mdf(path)
    r = read(path, inputs={"u": "b"}, outputs={"y": "fast/a"})
    np.testing.assert_allclose(r.time, T, atol=1e-12)
    np.testing.assert_array_equal(np.c_[r.y, r.u], np.c_[A, B])
    assert (r.output_unit.item(), r.attrs["begin"]) == ("V", "2026-03-01T10:00:00")
    with pytest.raises(DataError, match="no column 'a': known: b, fast/a"):
        read(path, inputs={}, outputs={"y": "a"})
    with pytest.raises(DataError, match="'gear' is a channel of words"):
        read(path, inputs={}, outputs={"y": "gear"})
    with pytest.raises(DataError, match="sampled at different times"):
        read(path, inputs={}, outputs={"a": "fast/a", "b": "slow/a"})
    with pytest.raises(DataError, match="sampled at different times"):
        read(path, inputs={}, outputs={"a": "fast/a"}, time="slow/time")
    slow = read(path, inputs={}, outputs={"s": "slow/a"})
    assert merge(r, slow).sizes["output"] == 2
    found = list_columns(path)
    assert [c.name for c in found.signals] == ["b", "fast/a", "slow/a"]


def test_samples_that_mdf_marks_as_invalid_are_not_measured(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    bad = np.arange(N) == 3
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(A, T, name="a", invalidation_bits=bad)])
        file.save(tmp_path / "r.mf4")
    r = read(tmp_path / "r.mf4", inputs={}, outputs={"y": "a"})
    np.testing.assert_array_equal(np.isnan(r.y[:, 0]), bad)


@pytest.mark.parametrize("part", [0.2, 0.5, 0.9])
def test_mdf_that_is_cut_off_is_one_clear_line(tmp_path, part):
    path = tmp_path / "r.mf4"
    write_mdf(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(DataError) as said:
        read(path, inputs={}, outputs={"y": "fast/a"})
    assert "\n" not in str(said.value)


def test_units_of_universal_files_by_their_system(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "r.uff"
    file = pyuff.UFF(str(path))
    file.write_sets(pyuff.prepare_151("bridge", "d", "x", program="y"), "add")
    units = {"length": 1000.0, "force": 1000.0, "temp": 1.0, "temp_offset": 273.15}
    file.write_sets(pyuff.prepare_164(5, "mm", 1, **units), "add")
    for k, (name, kind) in enumerate((("a", 12), ("F", 13), ("q", 8), ("e", 3))):
        head = pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=k, rsp_dir=1, ref_node=0, ref_dir=0, data=A, x=T,
            id1=name, rsp_ent_name=f"p{k}", ref_ent_name="NONE", abscissa_spacing=1,
            abscissa_spec_data_type=17, ordinate_spec_data_type=kind, orddenom_spec_data_type=0,
        )  # fmt: skip
        file.write_sets(head, "add")
    metres = {"name": "a", "unit": "m/s^2"}
    r = read(path, inputs={"F": "F"}, outputs={"a": metres, "q": "q", "e": "e"})
    assert r.input_unit.item() == "mN"
    assert r.output_unit.values.tolist() == ["m/s^2", "mm", ""]
    np.testing.assert_allclose(r.y[:, 0], 1e-3 * A, rtol=1e-6)
    assert r.attrs["understood"] == "model 'bridge'"
