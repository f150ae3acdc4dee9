"""``backsight fleet`` and its page, as a user has them."""

import subprocess
import sys

import pandas as pd
import pytest
from tests.fleet.springs import write_fleet, write_recording
from tests.workbench.browser import FOUND, browsing
from typer.testing import CliRunner

from backsight.cli import app
from backsight.output import holding


def backsight(*arguments):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """A fleet of three, of which one fails, after the command."""
    folder = tmp_path_factory.mktemp("commanded")
    text = 'title = "Springs"\nproblem = "spring.toml"\nrecordings.table = "runs.csv"\n'
    path = write_fleet(folder, count=60, fleet=text)
    (folder / "runs" / "r1.csv").write_text("t,force\n0,1\n", encoding="utf-8")
    lines = ["file,temperature,rig"]
    lines += [f"runs/r{k}.csv,{20 + k % 7},{'AB'[k % 2]} <b>" for k in range(60)]
    (folder / "runs.csv").write_text("\n".join(lines), encoding="utf-8")
    return folder, backsight("fleet", path, "--out", folder / "store", "--workers", 0)


def test_what_is_said_and_written(fleet):
    folder, (code, printed, told) = fleet
    assert code == 1
    assert printed.startswith("Springs: 60 recordings, 1 setting; 60 done; 1 of 60 rows failed")
    assert told.startswith("backsight: runs/r1.csv: ")
    assert "no column 'place'" in told
    table = pd.read_csv(folder / "store" / "rows.csv")
    pd.testing.assert_frame_equal(
        table[["recording", "temperature", "q"]],
        pd.read_parquet(folder / "store" / "rows.parquet")[["recording", "temperature", "q"]],
    )
    assert len(table) == 60


def test_the_report_of_a_row(fleet, tmp_path):
    folder, _ = fleet
    item = pd.read_csv(folder / "store" / "rows.csv")["item"][0]
    code, _, told = backsight(
        "report", folder / "store", "--item", item, "--out", tmp_path / "one.html"
    )
    assert (code, told) == (0, "")
    assert "Springs: runs/r0.csv" in (tmp_path / "one.html").read_text(encoding="utf-8")
    for arguments in (["--item", "none"], []):
        code, _, told = backsight("report", folder / "store", *arguments, "--out", tmp_path / "no")
        assert code == 2
        assert told.count("\n") == 1


def test_what_is_at_fault_is_said_in_a_line(fleet, tmp_path):
    folder, _ = fleet
    command = ("fleet", folder / "fleet.toml", "--workers", 0, "--out")
    with holding(folder / "store"):
        code, printed, told = backsight(*command, folder / "store")
    assert (code, printed) == (2, "")
    assert "another process writes" in told
    (tmp_path / "file").write_text("", encoding="utf-8")
    for out in (tmp_path / "file", "/proc/none"):
        code, printed, told = backsight(*command, out)
        assert (code, printed, told.count("\n")) == (2, "", 1)
    code, _, told = backsight("fleet", tmp_path / "none.toml", "--out", tmp_path / "out")
    assert (code, told.count("\n")) == (2, 1)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_twenty_at_once_on_one_folder(tmp_path):
    """One does the work, the others are refused; nobody shows a traceback."""
    path = write_fleet(tmp_path, count=40)
    command = [sys.executable, "-m", "backsight", "fleet", path, "--workers", "0"]
    command += ["--out", tmp_path / "store"]
    crowd = [
        subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        for _ in range(20)
    ]
    ends = [(one.communicate()[1], one.returncode) for one in crowd]
    assert {code for _, code in ends} <= {0, 2}
    assert any(code == 0 for _, code in ends)
    assert all(told.count("\n") <= 1 and "Traceback" not in told for told, _ in ends)
    assert len(pd.read_csv(tmp_path / "store" / "rows.csv")) == 40


def test_a_folder_that_cannot_be_written(tmp_path):
    path = write_fleet(tmp_path, count=1)
    (tmp_path / "file").write_text("in the way")
    code, _, told = backsight("fleet", path, "--workers", 0, "--out", tmp_path / "file" / "store")
    assert (code, told.count("\n")) == (2, 1)


@pytest.mark.skipif(FOUND is None, reason="there is no Chromium")
def test_the_page_sorts_filters_and_leads_to_the_report(fleet, tmp_path):
    folder, _ = fleet
    with browsing(tmp_path / "browser") as page:
        page.size(1200, 900)
        page.go((folder / "store" / "fleet.html").as_uri())
        page.wait("document.querySelectorAll('#table tbody tr').length === 50")
        cell = "document.querySelector('#table tbody tr:first-child td:first-child').innerText"
        assert page.value(cell) == "runs/r1.csv"  # what failed comes first

        def ask(text):
            page.value(
                f"document.getElementById('filter').value = '{text}';"
                "document.getElementById('filter').dispatchEvent(new Event('input'))"
            )

        count = "document.getElementById('count').innerText"
        ask("rig = A <b>, temperature > 22")
        page.wait(f"{count} !== '60 rows'")
        expected = sum(k % 2 == 0 and 20 + k % 7 > 22 for k in range(60))
        assert page.value(count) == f"{expected} of 60 rows"
        ask("height > 3")
        page.wait("document.getElementById('complaint').innerText.includes('no column')")
        ask("")
        page.wait(f"{count} === '60 rows'")
        page.value("[...document.querySelectorAll('#table th')].find((h) =>"
                   " h.innerText.startsWith('temperature')).click()")  # fmt: skip
        assert page.value(cell) == "runs/r0.csv"  # 20 degrees, and the first of them
        page.click("#table tbody tr:first-child td")
        item = pd.read_csv(folder / "store" / "rows.csv")["item"][0]
        assert f"--item {item}" in page.value("document.querySelector('#one pre').innerText")
        assert page.value("document.querySelectorAll('#trend .dots').length") >= 1
        assert page.complaints == []


def test_a_page_has_no_markup_of_names(tmp_path):
    path = write_fleet(tmp_path, count=0)
    write_recording(tmp_path / "runs" / "<script>alert(1)<script>.csv", 0)
    code, _, _ = backsight("fleet", path, "--workers", 0, "--out", tmp_path / "store")
    assert code == 0
    assert "alert(1)" not in (tmp_path / "store" / "fleet.html").read_text(encoding="utf-8")
