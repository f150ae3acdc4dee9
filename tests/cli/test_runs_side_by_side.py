"""Names of several runs on one page."""

from pathlib import Path

from backsight.cli._reporting import _names_of_runs


def test_runs_are_named_by_their_folders():
    files = [Path("monday/estimates.nc"), Path("tuesday/estimates.nc")]
    assert list(_names_of_runs(files).values()) == ["monday", "tuesday"]


def test_runs_whose_folders_have_the_same_name_stay_apart():
    files = [Path("a/out/estimates.nc"), Path("b/out/estimates.nc")]
    assert len(set(_names_of_runs(files).values())) == 2
