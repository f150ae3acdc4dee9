"""Recordings from elsewhere: no byte of other files, no foreign program, no memory for nothing."""

import io
import os
import pickle
import struct
import time
import zipfile
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
import xarray as xr

from backsight.data import _room as room
from backsight.data import read
from backsight.errors import DataError

N = 50
T, U = np.arange(N) * 0.1, np.ones(N)
SECRET = b"password = hunter2; this is somebody's file and no recording at all......."


def signals(path, **more):
    return read(path, inputs={"u": "u"}, outputs={"y": "y"}, time="t", **more)


@pytest.fixture
def secret(tmp_path):
    (tmp_path / "secret.txt").write_bytes(SECRET)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["y"] = np.arange(N, dtype=float)
        file["g/y"] = np.arange(N, dtype=float)
    return tmp_path


def external(file, folder):
    file.create_dataset("y", (N,), "u1", external=[(str(folder / "secret.txt"), 0, N)])


def external_in_parts(file, folder):
    parts = [(str(folder / "secret.txt"), 0, 25), (str(folder / "secret.txt"), 25, 25)]
    file.create_dataset("y", (N,), "u1", external=parts)


def external_link(file, folder):
    file["y"] = h5py.ExternalLink(str(folder / "other.h5"), "y")


def external_by_group(file, folder):
    file["g"] = h5py.ExternalLink(str(folder / "other.h5"), "g")
    file["y"] = h5py.SoftLink("/g/y")


def virtual(file, folder):
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "y", (N,))
    file.create_virtual_dataset("y", layout)


def virtual_of_external(file, folder):
    """The source is in the same file, and its bytes are not."""
    file.create_dataset("z", (N,), "u1", external=[(str(folder / "secret.txt"), 0, N)])
    layout = h5py.VirtualLayout((N,), "u1")
    layout[:] = h5py.VirtualSource(".", "z", (N,))
    file.create_virtual_dataset("y", layout)


ELSEWHERE = [
    external,
    external_in_parts,
    external_link,
    external_by_group,
    virtual,
    virtual_of_external,
]


def write(folder, put, name="a.h5"):
    path = folder / name
    with h5py.File(path, "w", userblock_size=512 if name.endswith("mat") else 0) as file:
        file["t"], file["u"] = T, U
        put(file, folder)
    if name.endswith("mat"):
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


@pytest.mark.parametrize("name", ["a.h5", "a.nc", "a.mat"])
@pytest.mark.parametrize("put", ELSEWHERE)
def test_no_value_comes_from_another_file(secret, put, name):
    path = write(secret, put, name)
    message = "another file|a link to '/g/y' in the same file"
    with pytest.raises(DataError, match=message) as caught:
        signals(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.h5", "a.mat"])
def test_the_file_that_is_allowed_by_name_is_read(secret, name):
    raw, other = str(secret / "secret.txt"), str(secret / "other.h5")
    path = write(secret, external, name)
    assert bytes(signals(path, outside=[raw]).y.values.ravel().astype("u1")) == SECRET[:N]
    with pytest.raises(DataError, match="is stored in another file"):
        signals(path, outside=[other, "secret.txt"])
    for put in (external_link, virtual):
        found = signals(write(secret, put, name), outside=[other])
        np.testing.assert_array_equal(found.y[:, 0], np.arange(N))


def test_a_link_that_is_not_wanted_is_not_followed(secret):
    def put(file, folder):
        file["y"] = U
        file["more"] = h5py.ExternalLink(str(folder / "other.h5"), "y")
        file["soft"] = h5py.SoftLink("/nowhere")

    assert signals(write(secret, put)).sizes["time"] == N
    with pytest.raises(DataError, match="'more' is a link to another file"):
        signals(write(secret, put, "a.nc"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
@pytest.mark.parametrize("name", ["a.h5", "a.nc"])
def test_a_link_to_a_pipe_does_not_wait_for_ever(secret, name):
    os.mkfifo(secret / "pipe")

    def put(file, folder):
        file["y"] = h5py.ExternalLink(str(folder / "pipe"), "y")

    with pytest.raises(DataError, match="a link to another file"):
        signals(write(secret, put, name))


def test_a_filter_that_is_a_program_from_elsewhere_is_not_loaded(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["t"], file["u"] = T, U
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((N,))
        plan.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, (3,))
        space = h5py.h5s.create_simple((N,))
        h5py.h5d.create(file.id, b"y", h5py.h5t.NATIVE_DOUBLE, space, plan)
    with pytest.raises(DataError, match=r"needs the filter 32015 .*h5repack"):
        signals(path)


@pytest.mark.parametrize("name", ["a.h5", "a.nc", "a.mat"])
@pytest.mark.parametrize("compression", ["gzip", "lzf", None])
def test_the_filters_that_everybody_has_are_read(tmp_path, name, compression):
    def put(file, _):
        more = {"chunks": (10,), "shuffle": True, "fletcher32": True} if compression else {}
        file.create_dataset("y", data=U, compression=compression, **more)

    np.testing.assert_array_equal(signals(write(tmp_path, put, name)).y[:, 0], U)


def references(file, _):
    file.create_dataset("y", data=np.array([file["t"].ref] * N, dtype=h5py.ref_dtype))


def ragged(file, _):
    file.create_dataset("y", (N,), dtype=h5py.vlen_dtype("f8"))


def compound(file, _):
    file["y"] = np.zeros(N, [("a", "f8"), ("b", "i4")])


def empty(file, _):
    file["y"] = h5py.Empty("f8")


def claims(samples):
    def put(file, _):
        file.create_dataset("y", (samples,), dtype="f8", chunks=(10**6,), compression="gzip")

    return put


@pytest.mark.parametrize(
    ("put", "message"),
    [
        (references, "not an array of real numbers"),
        (ragged, "not an array of real numbers"),
        (compound, "not an array of real numbers"),
        (empty, "'y' is empty"),
        (claims(10**12), "'y' claims 8 TB, but the file holds 0 bytes of it"),
        (claims(3 * 10**8), r"'y' claims 2.4 GB, but the file holds 0 bytes of it"),
    ],
)
@pytest.mark.parametrize("name", ["a.h5", "a.mat"])
def test_what_holds_no_numbers_is_refused_before_it_is_read(tmp_path, put, message, name):
    path = write(tmp_path, put, name)
    began = time.perf_counter()
    with pytest.raises(DataError, match=message):
        signals(path)
    assert time.perf_counter() - began < 2.0


@pytest.mark.parametrize("name", ["a.h5", "a.nc", "a.npz", "a.mat", "a.csv"])
def test_more_than_there_is_memory_is_refused(tmp_path, monkeypatch, name):
    path = tmp_path / name
    if name == "a.npz":
        np.savez(path, t=T, u=U, y=U)
    elif name == "a.mat":
        scipy.io.savemat(path, {"t": T, "u": U, "y": U}, do_compression=True)
    elif name == "a.csv":
        path.write_text("t,u,y\n" + "".join(f"{t},1,1\n" for t in T))
    else:
        write(tmp_path, lambda file, _: file.create_dataset("y", data=U), name)
    assert signals(path).sizes["time"] == N
    monkeypatch.setattr(room, "_available", lambda: 1000)
    monkeypatch.setattr(room, "_SMALL", 0)
    with pytest.raises(DataError, match=r"of memory are needed, but only 1 kB are free"):
        signals(path)


class Program:
    """Runs when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


def test_no_program_in_a_file_is_run(tmp_path):
    mark = tmp_path / "ran"
    evil = np.array([Program(mark)], dtype=object)
    np.savez(tmp_path / "member.npz", t=T, u=U, y=evil)
    np.save(tmp_path / "alone.npy", evil, allow_pickle=True)
    (tmp_path / "alone.npy").rename(tmp_path / "alone.npz")
    for name in ("pickle.npz", "pickle.mat", "pickle.h5", "pickle.nc"):
        (tmp_path / name).write_bytes(pickle.dumps(Program(mark)))
    for path in [p for p in tmp_path.iterdir() if p.is_file()]:
        with pytest.raises(DataError):
            signals(path)
    assert not mark.exists()


def member(folder, head, body=b""):
    """An archive whose member y has this head."""
    path = folder / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in (("t", T), ("u", U)):
            content = io.BytesIO()
            np.save(content, values)
            archive.writestr(f"{name}.npy", content.getvalue())
        text = head.encode() + b" " * (64 - (11 + len(head)) % 64) + b"\n"
        size = len(text).to_bytes(2, "little")
        archive.writestr("y.npy", b"\x93NUMPY\x01\x00" + size + text + body)
    return path


@pytest.mark.parametrize("shape", ["(1000000000000,)", f"({10**30},)", "(-5,)", "('a',)", "5"])
@pytest.mark.parametrize("kind", ["<f8", "|O", "V0", "<U0", "nonsense"])
def test_a_member_that_claims_too_much_is_refused(tmp_path, shape, kind):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    with pytest.raises(DataError):
        signals(member(tmp_path, head))


@pytest.mark.parametrize("head", ["__import__('os').mkdir('x')", "(" * 4000, "[" * 400, "{}", ""])
def test_a_head_that_is_none_is_refused(tmp_path, head):
    with pytest.raises(DataError, match="cannot be read"):
        signals(member(tmp_path, head))


def test_a_zip_bomb_is_refused_by_what_it_claims(tmp_path, monkeypatch):
    head = "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000,), }"
    path = member(tmp_path, head, bytes(80_000_000))
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(room, "_available", lambda: 200_000_000)
    with pytest.raises(DataError, match="'y' claims 80 MB, for which 320 MB"):
        signals(path)


def mat_5(folder, variable):
    path = folder / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + variable)
    return path


def test_a_mat_file_that_claims_too_much_is_refused(tmp_path):
    body = zlib.compress(struct.pack("<II", 14, 3_000_000_000) + bytes(10_000))
    with pytest.raises(DataError, match="claims 3 GB, but the file holds"):
        signals(mat_5(tmp_path, struct.pack("<II", 15, len(body)) + body))


@pytest.mark.parametrize("variable", [b"", b"\x0e", b"\x0f\0\0\0\xff\xff\xff\xff", b"\xff" * 999])
def test_a_mat_file_of_nonsense_is_refused(tmp_path, variable):
    with pytest.raises(DataError):
        signals(mat_5(tmp_path, variable))


def test_only_the_variables_that_are_wanted_are_read(tmp_path, monkeypatch):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": T, "u": U, "y": U, "more": np.array(["a", {}], dtype=object)})
    loaded = []
    load = scipy.io.loadmat
    monkeypatch.setattr(
        scipy.io, "loadmat", lambda *a, **k: loaded.append(load(*a, **k)) or loaded[-1]
    )
    signals(path)
    assert {k for k in loaded[0] if not k.startswith("__")} == {"t", "u", "y"}
    with pytest.raises(DataError, match="did you mean 'more'"):
        read(path, inputs={}, outputs={"y": "mor"}, time="t")


def test_a_coordinate_of_a_netcdf_file_that_is_not_wanted_is_not_read(tmp_path):
    path = tmp_path / "a.nc"
    times = {"t": ("k", T), "u": ("k", U), "y": ("k", U)}
    xr.Dataset(times, coords={"k": np.arange(N)}).to_netcdf(path, engine="h5netcdf")
    assert signals(path).sizes["time"] == N


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/stdin", "/dev/tty"])
@pytest.mark.skipif(os.name == "nt", reason="devices are files on POSIX")
def test_a_device_is_no_recording(tmp_path, name):
    for kind in (".csv", ".h5", ".npz"):
        path = tmp_path / f"a{kind}"
        path.unlink(missing_ok=True)
        path.symlink_to(name)
        with pytest.raises(DataError, match=r"a device or a pipe|no file|cannot read"):
            signals(path)


@pytest.mark.parametrize("name", ["x" * 5000 + ".csv", "a\0.csv", "a/" * 3000 + "b.csv", ""])
def test_a_name_that_no_file_can_have_is_one_line(tmp_path, name):
    with pytest.raises(DataError) as caught:
        signals(f"{tmp_path}/{name}")
    assert len(str(caught.value)) <= 2000
    assert "\n" not in str(caught.value)
