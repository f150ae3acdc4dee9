"""A report on paper is light, whatever the user prefers on the screen."""

import numpy as np
import pytest
from tests.workbench.browser import FOUND, browsing

import backsight as bs


@pytest.mark.skipif(FOUND is None, reason="there is no Chromium")
def test_plots_are_drawn_in_the_colours_of_paper(tmp_path):
    model = bs.sdof(k=40.0, b=0.8)
    data = bs.simulate(model, np.ones((50, 1)), dt=0.01, sigma_y=1e-3, seed=1)
    noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-3), bs.Prior(sigma_x0=0.1)
    page_file = tmp_path / "report.html"
    bs.report(bs.compare({"EKF": bs.EKF(noise, prior)}, model, data, engine="vm"), page_file)
    colour = "document.querySelector('.js-plotly-plot')?._fullLayout?.paper_bgcolor"
    with browsing(tmp_path / "browser") as page:
        page.size(1000, 800, dark=True)
        page.go(page_file.as_uri())
        page.wait(f"!!{colour}")
        dark = page.value(colour)
        page.value("dispatchEvent(new Event('beforeprint'))")
        page.wait(f"{colour} !== '{dark}'")
        assert page.value(colour) == "#fcfcfa"
        page.value("dispatchEvent(new Event('afterprint'))")
        page.wait(f"{colour} === '{dark}'")
        assert page.complaints == []
