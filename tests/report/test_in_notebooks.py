"""A report in a notebook."""

import html
import re

from backsight.report import report


def test_the_path_of_a_report_shows_the_page(result, tmp_path):
    path = report({"KF": result}, tmp_path / "page.html")
    shown = re.fullmatch(
        r'<iframe srcdoc="([^"]*)" title="page" [^>]*></iframe>', path._repr_html_()
    )
    assert html.unescape(shown[1]) == path.read_text("utf-8")
    assert path.parent == tmp_path


def test_a_path_made_of_it_is_a_path(result, tmp_path):
    path = report({"KF": result}, tmp_path / "page.html")
    assert path.with_suffix(".txt")._repr_html_() is None
    path.unlink()
    assert path._repr_html_() is None
