"""A folder of files that are there together or not at all."""

import pytest

from backsight.errors import OutputError
from backsight.output import whole


def test_files_appear_when_the_block_ends(tmp_path):
    out = tmp_path / "a" / "b"
    with whole(out) as folder:
        (folder / "one").write_text("1")
        assert not out.exists()
    assert [(p.name, p.read_text()) for p in out.iterdir()] == [("one", "1")]
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_files_of_the_same_name_are_replaced_and_others_stay(tmp_path):
    (tmp_path / "one").write_text("old")
    (tmp_path / "other").write_text("stays")
    with whole(tmp_path) as folder:
        (folder / "one").write_text("new")
    assert (tmp_path / "one").read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one", "other"]


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
