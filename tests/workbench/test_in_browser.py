"""The page itself, in a browser: what a user clicks, and what is seen then."""

import time

import pytest
from tests.workbench.browser import FOUND, browsing
from tests.workbench.conftest import MOTOR

pytestmark = pytest.mark.skipif(FOUND is None, reason="there is no Chromium")

MOST_CLICKS, MOST_SECONDS = 12, 120.0


@pytest.fixture(scope="module")
def page(served, tmp_path_factory):
    """The workbench in a browser, with the recording dropped on it."""
    with browsing(tmp_path_factory.mktemp("browser")) as found:
        found.size(1400, 1000)
        found.go(served.address)
        found.wait("document.readyState == 'complete' && !!document.querySelector('#file')")
        found.choose_file("#file", MOTOR)
        found.wait("!!document.querySelector('#gallery input')")
        yield found


def test_a_motor_takes_few_clicks(page, monkeypatch):
    clicks, begin, click = 1, time.monotonic(), page.click  # the first one chose the file

    def counted(selector):
        nonlocal clicks
        clicks += 1
        click(selector)

    monkeypatch.setattr(page, "click", counted)
    page.click("label:has(input[value=motor])")
    page.wait("!document.querySelector('#run').disabled")
    page.type("[aria-label='value of kt']", "0,11")  # as a German types it
    page.type("[aria-label='value of J']", "2e-3")
    page.wait("document.querySelector('#text').value.includes('start = 0.002')")
    text = page.value("document.querySelector('#text').value")
    assert "kt = { value = 0.11," in text
    assert "J = { start = 0.002, sigma = 0.0006," in text  # as doubtful as the first guess
    page.click("input[aria-label=EKF]")
    page.click("input[aria-label=MHE]")
    page.wait("document.querySelector('#text').value.includes('[estimators.EKF]')")
    page.wait("!document.querySelector('#text').value.includes('[estimators.MHE]')")
    page.wait("!document.querySelector('#run').disabled")
    page.click("#run")
    page.wait("!document.querySelector('#report').hidden")
    assert clicks <= MOST_CLICKS
    assert time.monotonic() - begin < MOST_SECONDS
    assert page.complaints == []


def test_what_is_wrong_is_said_while_it_is_written(page):
    page.click("label:has(input[value=equations])")
    page.wait("!document.querySelector('#equations').hidden")
    page.wait("document.querySelector('#checked').className == 'wrong'")
    assert page.value("document.querySelector('#run').disabled")
    for column, role in (("current", "inputs:current"), ("speed", "outputs:speed")):
        page.value(
            f"(() => {{ const s = document.querySelector('[aria-label=\"{column} is\"]');"
            f" s.value = '{role}'; s.dispatchEvent(new Event('change')); }})()"
        )
        page.wait(f"document.querySelector('[aria-label=\"{column} is\"]').value == '{role}'")
    page.type("#own", "w' = (kt*current - load)/J\nspeed = w")
    page.wait("!!document.querySelector('[aria-label=\"value of load\"]')")
    page.wait("document.querySelector('#checked').className == 'right'")
    page.type("#own", "w' = (kt*current - load)/J +\nspeed = w")
    page.wait("document.querySelector('#checked').className == 'wrong'")
    assert "equation 'w', column 24" in page.value("document.querySelector('#checked').textContent")


@pytest.mark.parametrize(("width", "height"), [(1400, 1000), (390, 800)])
def test_nothing_reaches_beyond_the_window(page, width, height):
    page.size(width, height)
    assert page.value("document.documentElement.scrollWidth <= window.innerWidth")


def test_every_field_has_a_name(page):
    nameless = page.value(
        "[...document.querySelectorAll('input, select, textarea, button, iframe, progress')]"
        ".filter((e) => !e.labels?.length && !e.ariaLabel && !e.title && !e.textContent.trim())"
        ".map((e) => e.outerHTML)"
    )
    assert nameless == []
