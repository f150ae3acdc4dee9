"""Machine code is taken from nobody but the user, and nothing of others is touched."""

import hashlib
import hmac
import json
import os
import stat
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest

from backsight.engine import _cache as cache
from backsight.engine import _private as private
from backsight.errors import BacksightWarning
from engine.test_cache import estimate, folder, forget

__all__ = ["folder"]

posix = pytest.mark.skipif(os.name == "nt", reason="owners and modes are those of POSIX")
root = pytest.mark.skipif(
    getattr(os, "geteuid", lambda: 1)() != 0, reason="only root can give files to others"
)


@pytest.fixture
def key_place(tmp_path, monkeypatch):
    """An empty place for the key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(private.sys, "platform", "linux")
    cache._key.cache_clear()
    yield tmp_path / "state" / "backsight"
    cache._key.cache_clear()


def test_the_users_own_files_in_the_chosen_folder_stay(folder, monkeypatch):
    monkeypatch.setattr(cache, "KEEP", 3)
    chosen = folder.parent
    folder.mkdir(parents=True, mode=0o700)
    for place in (chosen, folder):
        place.chmod(0o700)
        for k in range(20):
            for name in (f"thesis_{k}", f"thesis_{k}.txt", f".thesis_{k}.0123abcd.bak"):
                (place / name).write_text("precious")
                os.utime(place / name, (1e9 + k, 1e9 + k))
    for k in range(10):
        cache.keep(f"program_{k}", b"code")
    for place in (chosen, folder):
        assert len([p for p in place.iterdir() if "thesis" in p.name]) == 60
        assert {p.read_text() for p in place.iterdir() if "thesis" in p.name} == {"precious"}


def test_what_a_killed_process_left_is_removed_when_it_is_old(folder):
    cache.keep("program", b"code")
    old, new = folder / ".program.0123abcd.tmp", folder / ".program.4567abcd.tmp"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1e9, 1e9))
    cache.keep("other", b"code")
    assert not old.exists()
    assert new.exists()


def others(path: Path, change: str) -> None:
    if change == "owner":
        os.chown(path, 12345, 12345)
    else:
        path.chmod(path.stat().st_mode | {"group": stat.S_IWGRP, "world": stat.S_IWOTH}[change])


CHANGES = ["group", "world", pytest.param("owner", marks=root)]


@posix
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("what", ["chosen", "own", "file"])
def test_what_others_may_have_written_is_not_run(folder, what, change, monkeypatch):
    first = estimate()
    (file,) = folder.iterdir()
    others({"chosen": folder.parent, "own": folder, "file": file}[what], change)
    before = file.read_bytes()
    with pytest.warns(BacksightWarning, match="chmod go-w|belongs to another user") as said:
        again = estimate()
    assert np.array_equal(again, first)
    assert len(said) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate()  # said once
    if what != "file":
        assert file.read_bytes() == before


@posix
def test_a_folder_of_the_system_for_everybody_will_do(folder):
    chosen = folder.parent
    chosen.mkdir()
    chosen.chmod(0o1777)
    cache.keep("program", b"code")
    assert cache.read_kept("program") == b"code"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "program").stat().st_mode) == 0o600


def test_a_digest_without_the_key_is_worth_nothing(folder):
    first = estimate()
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    body = whole[len(cache._MAGIC) + 32 :]
    forged = [
        hashlib.sha256(body).digest(),
        hmac.digest(b"", f"{file.name}\n".encode() + body, "sha256"),
        hmac.digest(bytes(32), f"{file.name}\n".encode() + body, "sha256"),
    ]
    for digest in forged:
        file.write_bytes(cache._MAGIC + digest + body)
        assert cache.read_kept(file.name) is None
    assert np.array_equal(estimate(), first)
    assert file.read_bytes() == whole


def test_a_file_does_not_pass_for_another_one(folder):
    cache.keep("one", b"code")
    (folder / "one").rename(folder / "two")
    assert cache.read_kept("two") is None


@pytest.mark.parametrize(
    "body",
    [
        b"x" * 500,
        b"",
        b"\n",
        b"[[], []]\n",
        b"[[1.5], []]\ncode",
        b"[[-1], []]\ncode",
        b'{"a": 1}\ncode',
        b"[1, 2]\ncode",
        b"[" * 100_000 + b"\ncode",
        b"\xff\xfe\ncode",
    ],
)
def test_what_is_kept_but_no_program_is_compiled_again(folder, body):
    first = estimate()
    (file,) = folder.iterdir()
    cache.keep(file.name, body)
    assert cache.read_kept(file.name) == body
    assert np.array_equal(estimate(), first)
    assert json.loads(cache.read_kept(file.name).partition(b"\n")[0])


@posix
def test_the_key_is_secret_and_stays(key_place):
    made = private.key()
    (path,) = key_place.iterdir()
    assert len(made) == 32
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(key_place.stat().st_mode) == 0o700
    assert private.key() == made


def test_processes_that_begin_together_agree_on_the_key(key_place):
    keys, barrier = [], threading.Barrier(8)

    def make() -> None:
        barrier.wait()
        keys.append(private.key())

    threads = [threading.Thread(target=make) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(keys)) == 1
    assert len(list(key_place.iterdir())) == 1


def test_a_key_that_is_cut_off_is_made_anew(key_place):
    first = private.key()
    (path,) = key_place.iterdir()
    path.write_bytes(first[:5])
    second = private.key()
    assert len(second) == 32
    assert second != first
    assert private.key() == second


@posix
def test_a_key_that_others_can_read_is_said_and_not_used(folder, key_place):
    private.key()
    (path,) = key_place.iterdir()
    path.chmod(0o644)
    with pytest.warns(BacksightWarning, match="can be read by others"):
        estimate()
    assert list(folder.iterdir()) == []


def test_without_a_home_it_is_said_once_and_compiled(folder, monkeypatch):
    def homeless(_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setattr(private.Path, "home", classmethod(homeless))
    monkeypatch.setattr(private.sys, "platform", "linux")
    forget()
    with pytest.warns(BacksightWarning, match="no private place for a key"):
        assert np.all(np.isfinite(estimate()))
    monkeypatch.delenv("BACKSIGHT_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert np.all(np.isfinite(estimate()))
