"""A folder of results on a disk that fails at every step: the old files or the new, all of them."""

import shutil

import pytest
from faulty_disk import Disk, builds_faults, commands, files

from backsight.output import MARKER, write_whole

pytestmark = pytest.mark.skipif(not builds_faults(), reason="needs Linux and gcc")

OLD, NEW = {"a": "a1", "b": "b1"}, {"a": "a2", "b": "b2", "c": "c2"}


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    with commands(folder) as found:
        found.warm("write", folder / "out", "a")
        yield found


@pytest.fixture
def out(tmp_path, disk):
    """A folder with old results, and a neighbour."""
    (tmp_path / "other").write_text("stays")
    assert disk("write", tmp_path / "out", *OLD.values(), under=tmp_path).code == 0
    return tmp_path / "out"


def seen(folder):
    """Names and contents; what is unfinished would show."""
    return {n: t.decode() for n, t in files(folder).items() if not n.startswith(".backsight")}


def settled(out):
    """What is found when something has been written there again."""
    write_whole(out / "z", b"z")
    found = seen(out)
    assert found.pop("z") == "z"
    return found


def steps(disk, out):
    """Number of steps, of a run that is undone."""
    kept = out.with_name("kept")
    shutil.copytree(out, kept)
    done = disk("write", out, *NEW.values(), under=out.parent)
    assert done.code == 0
    assert seen(out) == NEW
    shutil.rmtree(out)
    kept.rename(out)
    return done.trace


@pytest.mark.parametrize(
    ("kind", "fresh"),
    [
        ("kill", False),
        ("broken", False),
        *(
            pytest.param(kind, fresh, marks=pytest.mark.slow)
            for kind, fresh in [
                ("kill", True),
                ("broken", True),
                ("interrupt", False),
                ("interrupt", True),
            ]
        ),
    ],
)
def test_at_every_step(disk, out, kind, fresh):
    if fresh:
        shutil.rmtree(out)
    old = {} if fresh else OLD
    trace = steps(disk, out) if not fresh else None
    k, ends = 0, set()
    while True:
        shutil.rmtree(out, ignore_errors=True)
        if not fresh:
            disk("write", out, *OLD.values(), under=out.parent)
        done = disk("write", out, *NEW.values(), under=out.parent, kind=kind, at=k)
        if kind == "kill":
            found = settled(out) if out.exists() else {}
        else:
            found = seen(out)
            ends.add((done.code, found == NEW))
            assert done.told.count("\n") == (done.code != 0)
            assert ("nothing is written" in done.told) <= (found != NEW)
            assert ("are written" in done.told) <= (found == NEW)
        assert found in (old, NEW)
        for folder in (out, out.parent):  # whoever comes next tidies up
            if folder.exists():
                write_whole(folder / "other", b"stays")
        left = {
            "other",
            *(f"out/{n}" for n in ("other", MARKER, *(["z"] * (kind == "kill")), *found)),
        }
        assert set(files(out.parent)) <= left
        k += 1
        if done.trace and len(done.trace) < k:
            break
    assert k > 15
    if kind == "interrupt":
        assert (130, False) in ends
    if kind == "broken":
        assert (2, False) in ends
    assert trace is None or len(trace) >= k - 1


def test_a_full_disk(disk, out):
    codes = []
    for room in (*range(0, 400, 13), 1000):
        shutil.rmtree(out, ignore_errors=True)
        disk("write", out, *OLD.values(), under=out.parent)
        done = disk("write", out, *NEW.values(), under=out.parent, kind="full", at=room)
        codes.append(done.code)
        assert seen(out) == (NEW if done.code == 0 else OLD)
        assert ("No space left" in done.told) == (done.code == 2)
        assert sorted(p.name for p in out.parent.iterdir()) == ["other", "out"]
    assert codes[0] == 2
    assert codes[-1] == 0


@pytest.mark.parametrize("fresh", [False, True], ids=["over old files", "a new folder"])
def test_a_power_cut(disk, out, tmp_path_factory, fresh):
    log, before = (tmp_path_factory.mktemp(name) for name in ("log", "before"))
    if fresh:
        shutil.rmtree(out)
    shutil.copytree(out.parent, before, dirs_exist_ok=True)
    assert disk("write", out, *NEW.values(), under=out.parent, log=log).code == 0
    cut = Disk(before, out.parent, log)
    found = []
    for each in cut.cuts():
        cut.build(each, out.parent)
        assert (out.parent / "other").read_text() == "stays"
        found.append(settled(out) if out.exists() else {})
        assert found[-1] in ({} if fresh else OLD, NEW), each
    # What was said to be written is there, whatever happens then.
    assert found[-1] == found[-3] == NEW
