"""Recordings from elsewhere: no byte of other files, no foreign program, no memory for nothing."""

import os
import time

import h5py
import numpy as np
import pytest
import scipy.io

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
