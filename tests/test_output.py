"""A folder of files that are there together or not at all, and that replace nothing of others."""

import contextlib
import json
import os
import threading
from pathlib import Path

import pytest

from backsight.errors import OutputError
from backsight.output import MARKER, whole


def write(out, force=False, known=True, **texts):
    names = [n.replace("_", ".") for n in texts]
    with whole(out, names=names if known else None, force=force) as folder:
        for name, text in zip(names, texts.values(), strict=True):
            (folder / name).write_text(text)


def seen(folder):
    """Names and contents, without the marker and without what is unfinished."""
    return {p.name: p.read_text() for p in folder.iterdir() if p.name != MARKER and p.is_file()}


def test_files_appear_when_the_block_ends(tmp_path):
    out = tmp_path / "a" / "b"
    with whole(out) as folder:
        (folder / "one").write_text("1")
        assert not out.exists()
    assert sorted((p.name, p.read_text()) for p in out.iterdir())[1:] == [("one", "1")]
    assert sorted(p.name for p in out.iterdir()) == [MARKER, "one"]
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_files_of_the_same_name_are_replaced_and_others_stay(tmp_path):
    write(tmp_path, one="old")
    (tmp_path / "other").write_text("stays")
    with whole(tmp_path) as folder:
        (folder / "one").write_text("new")
    assert (tmp_path / "one").read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == [MARKER, "one", "other"]


@pytest.mark.parametrize("reason", [ValueError, KeyboardInterrupt])
def test_nothing_is_left_behind_by_an_error(tmp_path, reason):
    def interrupted():
        with whole(tmp_path / "out") as folder:
            (folder / "one").write_text("half")
            raise reason

    with pytest.raises(reason):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_is_found_out_first(tmp_path):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "out"):
        with pytest.raises(OutputError, match="cannot write to the folder"), whole(out):
            pytest.fail("the block began")


@pytest.mark.parametrize("names", [["README.md", "Makefile", "ekf.c"], None])
def test_files_of_others_are_named_and_not_replaced(tmp_path, names):
    for name in ("README.md", "Makefile"):
        (tmp_path / name).write_text("mine")
    with (
        pytest.raises(OutputError, match=r"replaced: .*README\.md.*--force"),
        whole(tmp_path, names=names),
    ):
        pytest.fail("the block began")
    assert seen(tmp_path) == {"README.md": "mine", "Makefile": "mine"}


def test_a_file_that_appears_meanwhile_is_not_replaced_either(tmp_path):
    def work():
        with whole(tmp_path / "out") as folder:
            (folder / "one").write_text("new")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "one").write_text("mine")

    with pytest.raises(OutputError, match="replaced: one"):
        work()
    assert seen(tmp_path / "out") == {"one": "mine"}


@pytest.mark.parametrize("known", [True, False])
def test_force_replaces_them_and_nothing_else(tmp_path, known):
    (tmp_path / "one").write_text("mine")
    (tmp_path / "two").write_text("mine")
    write(tmp_path, force=True, known=known, one="new")
    assert seen(tmp_path) == {"one": "new", "two": "mine"}
    write(tmp_path, known=known, one="newer")
    assert seen(tmp_path) == {"one": "newer", "two": "mine"}
    with pytest.raises(OutputError, match="replaced: two"):
        write(tmp_path, two="new")


def test_beside_files_with_other_names_there_is_room(tmp_path):
    (tmp_path / "problem.toml").write_text("mine")
    write(tmp_path, report_html="new")
    assert seen(tmp_path) == {"problem.toml": "mine", "report.html": "new"}


def test_two_kinds_of_results_share_a_folder(tmp_path):
    write(tmp_path, one="1")
    write(tmp_path, two="2")
    write(tmp_path, one="3")
    assert seen(tmp_path) == {"one": "3", "two": "2"}


@pytest.mark.parametrize(
    "marker",
    [
        "",
        "nonsense",
        "[]",
        "{}",
        '{"files": ["one"]}',
        '{"program": "backsight", "files": 1}',
        '{"program": "other", "files": ["one"]}',
        "[" * 100_000,
        "\ud800",
    ],
)
def test_a_marker_of_others_marks_nothing(tmp_path, marker):
    (tmp_path / "one").write_text("mine")
    (tmp_path / MARKER).write_bytes(marker.encode("utf-8", "surrogatepass"))
    with pytest.raises(OutputError, match="replaced: one"):
        write(tmp_path, one="new")
    assert seen(tmp_path) == {"one": "mine"}


def test_a_marker_reaches_no_other_folder(tmp_path):
    (tmp_path / "victim").write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    files = ["../victim", "/etc/passwd", "..", "one", 1, None]
    (out / MARKER).write_text(json.dumps({"program": "backsight", "files": files}))
    write(out, one="new")
    assert json.loads((out / MARKER).read_text())["files"] == ["one"]
    assert seen(tmp_path) == {"victim": "mine"}


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
@pytest.mark.parametrize("force", [False, True])
def test_what_a_link_points_to_is_never_touched(tmp_path, force):
    victim, out = tmp_path / "victim", tmp_path / "out"
    victim.write_text("mine")
    out.mkdir()
    (out / "one").symlink_to(victim)
    (out / "two").symlink_to(tmp_path / "nowhere")
    if force:
        write(out, force=True, one="new", two="new")
        assert seen(out) == {"one": "new", "two": "new"}
        assert not (out / "one").is_symlink()
    else:
        with pytest.raises(OutputError, match="replaced: one, two"):
            write(out, one="new", two="new")
    assert victim.read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_linked_marker_is_none_and_a_linked_folder_is_one(tmp_path):
    real = tmp_path / "real"
    write(real, one="1")
    (tmp_path / "link").symlink_to(real)
    write(tmp_path / "link", one="2")
    assert seen(real) == {"one": "2"}
    other = tmp_path / "other"
    other.mkdir()
    (other / "one").write_text("mine")
    (other / MARKER).symlink_to(real / MARKER)
    with pytest.raises(OutputError, match="replaced: one"):
        write(other, one="new")


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_in_the_place_of_a_file_is_never_replaced(tmp_path, force):
    write(tmp_path, one="1", two="2")
    (tmp_path / "two").unlink()
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "thesis").write_text("mine")
    with pytest.raises(OutputError, match="has a folder two"):
        write(tmp_path, force=force, one="new", two="new")
    assert seen(tmp_path) == {"one": "1"}
    assert (tmp_path / "two" / "thesis").read_text() == "mine"


@pytest.mark.parametrize("fails_at", range(4))
@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("reason", [OSError("no space left"), KeyboardInterrupt()])
def test_an_error_while_files_move_brings_the_old_ones_back(
    tmp_path, monkeypatch, fails_at, links, reason
):
    write(tmp_path, one="1", two="2")
    marker = (tmp_path / MARKER).read_text()
    moves = []
    replace = Path.replace

    def failing(path, target):
        moves.append(path)
        if len(moves) == fails_at + 1:
            raise reason
        return replace(path, target)

    def no_link(*_, **__):
        raise OSError("not supported")

    monkeypatch.setattr(Path, "replace", failing)
    if not links:
        monkeypatch.setattr(os, "link", no_link)
    with pytest.raises((OutputError, KeyboardInterrupt)):
        write(tmp_path, one="new", two="new", three="new")
    monkeypatch.undo()
    assert seen(tmp_path) == {"one": "1", "two": "2"}
    assert (tmp_path / MARKER).read_text() == marker
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be killed anywhere")
@pytest.mark.parametrize("error_at", [None, 2])
@pytest.mark.parametrize("killed_at", range(6))
def test_what_a_killed_process_had_begun_is_finished(tmp_path, killed_at, error_at):
    """Killed at any move, on the way there or, after an error, on the way back."""
    write(tmp_path, one="1", two="2")
    child = os.fork()
    if not child:
        moves, replace = [], Path.replace

        def cut_off(path, target):
            if len(moves) == killed_at:
                os._exit(9)
            moves.append(path)
            if len(moves) == error_at:
                raise OSError("no space left")
            return replace(path, target)

        Path.replace = cut_off
        with contextlib.suppress(OutputError):
            write(tmp_path, one="new", two="new", three="new")
        os._exit(0)
    died = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    assert died == (killed_at < (4 if error_at is None else 5))
    write(tmp_path, four="4")
    found = seen(tmp_path)
    old, new = {"one": "1", "two": "2"}, {"one": "new", "two": "new", "three": "new"}
    assert found in [kind | {"four": "4"} for kind in (old, new)]
    came_back = error_at is not None and killed_at >= error_at
    assert ("three" not in found) == came_back
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*found, MARKER])


def test_a_process_at_work_is_left_alone(tmp_path):
    with whole(tmp_path, names=["one"]) as folder:
        (folder / "one").write_text("1")
        write(tmp_path, two="2")
        assert (folder / "one").exists()
    assert seen(tmp_path) == {"one": "1", "two": "2"}


def test_results_of_runs_at_once_do_not_mix(tmp_path):
    barrier = threading.Barrier(6)

    def work(k):
        with whole(tmp_path / "out", names=["one", "two", "three"]) as folder:
            for name in ("one", "two", "three"):
                (folder / name).write_text(str(k))
            barrier.wait()

    threads = [threading.Thread(target=work, args=[k]) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(seen(tmp_path / "out").values())) == 1
    assert len(list((tmp_path / "out").iterdir())) == 4
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_names_of_others_cannot_steer_a_terminal(tmp_path):
    (tmp_path / "a\x1b[2J").write_text("mine")
    with pytest.raises(OutputError) as caught, whole(tmp_path):
        pytest.fail("the block began")
    assert str(caught.value).isprintable()
