"""Take the pictures of `docs/workbench.md` with a headless Chromium, from the workbench itself.

Run it from the root of the project: ``python -m docs.figures.workbench``.
"""

import tempfile
import threading
import time
from pathlib import Path

from tests.workbench.browser import Page, browsing

from backsight.workbench._bench import Workbench
from backsight.workbench.serving import ready_to_serve

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 1280, 860
OUT = ROOT / "docs" / "images"


def take(page: Page, address: str) -> None:
    """Go the way of a user, and take a picture at every step."""
    page.size(WIDTH, HEIGHT)
    page.go(address)
    page.wait("document.readyState == 'complete' && !!document.querySelector('#file')")
    page.choose_file("#file", ROOT / "examples" / "motor" / "motor.csv")
    page.wait("!!document.querySelector('#gallery input')")
    keep(page, 1)
    page.click("label:has(input[value=motor])")
    page.wait("!document.querySelector('#run').disabled")
    page.type("[aria-label='value of kt']", "0.11")
    page.type("[aria-label='value of J']", "2e-3")
    page.wait("document.querySelector('#text').value.includes('start = 0.002')")
    page.wait("!document.querySelector('#run').disabled")
    page.value("document.querySelector('#machine').scrollIntoView()")
    keep(page, 2)
    page.click("#run")
    page.wait("!document.querySelector('#report').hidden", 120.0)
    time.sleep(3.0)  # the report draws itself in a frame of its own
    page.value("window.scrollTo(0, 0)")
    keep(page, 3)


def keep(page: Page, number: int) -> None:
    """Write a picture."""
    (OUT / f"workbench-{number}.png").write_bytes(page.picture())


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as browser:
        bench = Workbench(Path(folder))
        with ready_to_serve(bench) as (server, listening, address):
            thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
            thread.start()
            try:
                with browsing(Path(browser)) as page:
                    take(page, address)
            finally:
                server.should_exit = True
                thread.join()
