"""Compiled programs on disk."""

import os
import threading

import casadi as ca
import numpy as np
import pytest

from backsight.engine import _cache as cache
from backsight.engine import dense, lanes, native
from backsight.engine.llvm.module import LARGEST_LOCAL
from engine.examples import data_for, location, recursion


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where compiled programs will be, and nothing kept in memory."""
    monkeypatch.setenv("BACKSIGHT_CACHE", str(tmp_path / "programs"))
    forget()
    yield tmp_path / "programs" / cache.OWN
    forget()


def forget() -> None:
    native._compiled.cache_clear()
    cache._key.cache_clear()
    cache._say.cache_clear()


def estimate() -> np.ndarray:
    r = location()
    native._compiled.cache_clear()
    return native.run(r, data_for(r, 20), carry=r.carry0)[1][0]


def test_compiled_once(folder, monkeypatch):
    first = estimate()
    monkeypatch.setattr(native, "walk", lambda step: pytest.fail("compiled again"))
    assert np.array_equal(estimate(), first)
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize(
    "damage",
    [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:-1] + b"\0", lambda b: b"x" * 1000],
    ids=["empty", "truncated", "changed", "nonsense"],
)
def test_damaged_file_is_compiled_again(folder, damage):
    first = estimate()
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert np.array_equal(estimate(), first)
    assert file.read_bytes() == whole


def test_large_tables_are_kept_beside_the_code(folder, monkeypatch):
    """Constants that would be too much text for the compiler; the same for every lane."""
    rng, n = np.random.default_rng(0), 40
    table, rows = rng.standard_normal((n, n)), rng.standard_normal((6, n))
    c, x = ca.MX.sym("c"), ca.MX.sym("x", n)
    r = recursion(ca.Function("tables", [c, x], [c, dense.product_of(ca.MX(ca.DM(table)), x)]))
    assert n * n > LARGEST_LOCAL
    for _ in range(2):
        native._compiled.cache_clear()
        one = native.run(r, [rows], carry=r.carry0)[1][0]
        np.testing.assert_allclose(one, rows @ table.T, rtol=0, atol=1e-12)
        many = lanes.run_many(r, [[rows], [rows[:3]]], carries=[r.carry0] * 2)
        for _, (found,) in many:
            np.testing.assert_allclose(found, one[: len(found)], rtol=0, atol=1e-12)
        monkeypatch.setattr(native, "walk", lambda step: pytest.fail("compiled again"))


def test_other_version_is_another_file(folder, monkeypatch):
    estimate()
    monkeypatch.setattr(native, "_versions", lambda: ["other"])
    estimate()
    assert len(list(folder.iterdir())) == 2


def test_folder_that_cannot_be_made(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv("BACKSIGHT_CACHE", str(blocked / "programs"))
    assert np.all(np.isfinite(estimate()))
    assert blocked.read_text() == "in the way"


def test_failed_write_leaves_nothing(folder, monkeypatch):
    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", fail)
    assert np.all(np.isfinite(estimate()))
    assert list(folder.iterdir()) == []


def test_oldest_are_removed(folder, monkeypatch):
    monkeypatch.setattr(cache, "KEEP", 3)
    for k in range(5):
        cache.keep(f"program_{k}", bytes([k]))
        os.utime(folder / f"program_{k}", (k, k))
        if k == 3:
            assert cache.read_kept("program_1") == b"\1"
    assert sorted(f.name for f in folder.iterdir()) == ["program_1", "program_3", "program_4"]


def test_two_writers_and_a_reader(folder):
    bodies = [bytes([k]) * 100_000 for k in range(2)]
    cache.keep("program", bodies[0])

    def write(body: bytes) -> None:
        for _ in range(50):
            cache.keep("program", body)

    writers = [threading.Thread(target=write, args=[body]) for body in bodies]
    for writer in writers:
        writer.start()
    seen = {cache.read_kept("program") for _ in range(200)}
    for writer in writers:
        writer.join()
    assert seen <= set(bodies)
    assert [f.name for f in folder.iterdir()] == ["program"]


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {"XDG_CACHE_HOME": "/cache"}, "/cache/backsight"),
        ("linux", {"HOME": "/home/me"}, "/home/me/.cache/backsight"),
        ("darwin", {"HOME": "/home/me"}, "/home/me/Library/Caches/backsight"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/backsight"),
        ("linux", {"BACKSIGHT_CACHE": "/mine"}, "/mine"),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="the paths are those of POSIX")
def test_folder(monkeypatch, platform, variables, expected):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "BACKSIGHT_CACHE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(cache.sys, "platform", platform)
    assert cache.folder().as_posix() == expected
