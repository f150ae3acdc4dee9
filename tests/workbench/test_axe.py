"""No page has a finding of axe: workbench, dashboard, report, in both colours and on a phone."""

import contextlib
import time

import pytest
from tests.live.conftest import fed, message, samples
from tests.live.test_dashboard import shown
from tests.report.conftest import filtered
from tests.workbench.axe import THERE, findings
from tests.workbench.browser import FOUND, browsing
from tests.workbench.conftest import MOTOR

import backsight as bs

__all__ = ["fed", "samples"]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FOUND is None, reason="there is no Chromium"),
    pytest.mark.skipif(not THERE, reason="axe-core-python is not installed"),
]

SIZES = [(1280, False), (1280, True), (390, False)]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with browsing(tmp_path_factory.mktemp("browser")) as found:
        yield found


def in_all_sizes(page) -> list[str]:
    found = []
    for width, dark in SIZES:
        page.size(width, 900, dark=dark)
        page.value("new Promise((done) => setTimeout(done, 200))")
        found += [f"{width}{' dark' if dark else ''}: {f}" for f in findings(page)]
    return found


def test_a_page_with_faults_is_found(page):
    page.go("data:text/html,<html><body><img src='x'><input></body></html>")
    page.wait("document.readyState == 'complete'")
    assert {f.partition(":")[0] for f in findings(page)} >= {"image-alt", "label", "html-has-lang"}


def test_the_workbench_in_its_steps(page, served):
    page.size(1280, 900)
    page.go(served.address)
    page.wait("document.readyState == 'complete' && !!document.querySelector('#file')")
    assert in_all_sizes(page) == []
    page.choose_file("#file", MOTOR)
    page.wait("!!document.querySelector('#gallery input')")
    assert in_all_sizes(page) == []
    page.click("label:has(input[value=motor])")
    page.wait("!document.querySelector('#run').disabled")
    assert in_all_sizes(page) == []


def test_a_report(page, tmp_path):
    good = filtered()
    results = {"KF": good, "over-confident": filtered(noise_factor=0.1)}
    file = bs.report(results, tmp_path / "report.html", reference={"q": 0.0})
    for width, dark in SIZES:  # loaded in each size, since a phone folds its sections
        page.size(width, 900, dark=dark)
        page.go(file.as_uri())
        page.wait("document.readyState == 'complete' && !!document.querySelector('.take')")
        page.value("document.querySelectorAll('details').forEach((d) => (d.open = true))")
        page.value("new Promise((done) => setTimeout(done, 500))")
        assert findings(page) == []


def test_the_dashboard_of_a_run_with_an_alarm(page, tmp_path, samples):
    with contextlib.ExitStack() as stack:
        live, board, address = stack.enter_context(shown(tmp_path))
        live.feed(map(message, samples[:600]))
        page.go(address)
        page.wait("typeof known !== 'undefined' && known && history && charts.length > 0")
        page.value("new Promise((done) => setTimeout(done, 200))")
        board._due = 0.0
        board.publish(time.time())
        page.wait("document.querySelector('#light').className === 'bad'")
        page.wait("!document.querySelector('#alarms').hidden")
        assert in_all_sizes(page) == []
