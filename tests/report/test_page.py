import os
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from backsight.errors import DataError, OutputError
from backsight.report import report
from backsight.schema import STATUS_TEXT, Status
from report.unpacking import figures_of, unpacked

HOSTILE = "<script>alert('x')</script><!--"


class Elements(HTMLParser):
    """All start tags with their attributes, and the text outside scripts."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.text, self._inside = [], "", None
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside not in ("script", "style"):
            self.text += data


def written(results, folder, **more):
    return report(results, folder / "report.html", **more).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(result, gappy, tmp_path_factory):
    problem = "[model]\nkind = 'sdof'\n"
    folder = tmp_path_factory.mktemp("page")
    return written({"KF": result, "gappy": gappy}, folder, problem=problem, reference={"q": 0.0})


def test_the_page_needs_nothing_from_anywhere(page):
    tags = Elements(page).tags
    assert not [t for t, a in tags if t in ("link", "img", "iframe", "object", "embed", "base")]
    assert not [a for _, a in tags if {"src", "srcset", "data"} & set(a)]
    assert all(a["href"].startswith("#") for _, a in tags if "href" in a)
    policy = next(a["content"] for _, a in tags if a.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert "http" not in policy
    style = re.search(r"<style>(.*?)</style>", page, re.DOTALL)[1]
    assert "url(" not in style
    assert "@import" not in style


def test_plotly_is_there_once_and_sends_nothing_away(page):
    assert "plotly.js (cartesian - minified)" in unpacked(page, "plotly")[:100]
    assert "showSendToCloud: false" in page


def test_every_place_for_a_plot_has_its_figure(page):
    places = [a for t, a in Elements(page).tags if t == "figure"]
    assert len(places) == len(figures_of(page)) == 2 + 1 + 2 + 4 + 1 + 2
    assert all(a["aria-label"] for a in places)


def test_axes_have_units(page):
    headings = [f["layout"]["annotations"][0]["text"] for f in figures_of(page)]
    assert headings[:5] == ["q [m]", "v [m/s]", "q_m [m]", "a_m [m/s2]", "F [N/kg]"]
    assert headings[-1].endswith("[1]")
    assert '"time [s]"' in unpacked(page, "figures")


def test_table_ranks_and_shows_final_values(page):
    text = Elements(page).text
    for expected in ("log-likelihood", "mean NIS", "RMS innovation", "q_m [m]", "reference"):
        assert expected in text
    assert "nothing to report" in text
    assert "kind = 'sdof'" in text


def test_status_appears_with_cause_and_remedy_only_if_there_is_one(result, page, tmp_path):
    assert "<h2>Status</h2>" not in page
    code = result.status.values.copy()
    code[[5, 6]] = Status.CLIPPED
    told = written({"KF": result.assign(status=(("time",), code))}, tmp_path)
    assert "<h2>Status</h2>" in told
    assert STATUS_TEXT[Status.CLIPPED] in told
    assert figures_of(told)[-1]["traces"][0]["x"] == [0.05, 0.06]


def test_hostile_names_are_only_text(filtered, tmp_path):
    result = filtered(30, states=(HOSTILE, "v"))
    result = result.assign_coords(output=["%{x}<b>", "a"], state_unit=("state", [HOSTILE, "1"]))
    page = written(
        {HOSTILE: result}, tmp_path, problem=HOSTILE, title=HOSTILE, reference={HOSTILE: 1.0}
    )
    assert HOSTILE not in page
    assert "<!--" not in page.split("<script>")[0]
    parsed = Elements(page)
    assert [t for t, _ in parsed.tags].count("script") == 4  # library, figures, details, program
    assert parsed.text.count(HOSTILE) >= 5
    shown = [f["layout"]["annotations"][0]["text"] for f in figures_of(page)]
    names = [t["name"] for f in figures_of(page) for t in f["traces"] if "name" in t]
    assert not [s for s in shown + names if "<" in s or "%{" in s]


def test_a_name_like_a_colour_variable_stays_a_name(result, tmp_path):
    page = written({"--ink": result}, tmp_path)
    assert "--ink" in Elements(page).text


def test_problem_may_be_a_mapping(result, tmp_path):
    page = written({"KF": result}, tmp_path, problem={"model": {"kind": "sdof"}})
    assert '"kind": "sdof"' in Elements(page).text


def test_diverged_results_are_shown_up_to_there(result, tmp_path):
    bad = result.copy(deep=True)
    for name in ("x_hat", "x_std", "P", "y_hat", "e", "S"):
        bad[name][100:] = np.nan
    bad["status"][100:] = int(Status.NOT_FINITE)
    text = Elements(written({"bad": bad, "KF": result}, tmp_path)).text
    assert "bad: diverged" in text
    assert "KF explains the recording best" in text


def test_nothing_finite_at_all(result, tmp_path):
    nothing = result.copy(deep=True)
    for name in ("x_hat", "x_std", "P", "y_hat", "e", "S", "y", "x_true"):
        nothing[name][:] = np.nan
    assert "–" in Elements(written({"KF": nothing}, tmp_path)).text


def test_single_sample(result, tmp_path):
    text = Elements(written({"KF": result.isel(time=slice(0, 1))}, tmp_path)).text
    assert "1 sample every 10 ms" in text


def test_no_sample_is_refused(result, tmp_path):
    with pytest.raises(DataError, match="none of the 0 samples"):
        written({"KF": result.isel(time=slice(0, 0))}, tmp_path)
    assert os.listdir(tmp_path) == []


def test_single_estimator_is_not_ranked(result, tmp_path):
    text = Elements(written({"KF": result}, tmp_path)).text
    assert "KF: consistent" in text
    assert "best" not in text


def test_results_with_different_states(result, tmp_path):
    other = result.assign_coords(state=["q", "w"]).drop_vars("x_true")
    page = written({"a": result, "b": other}, tmp_path)
    headings = [f["layout"]["annotations"][0]["text"] for f in figures_of(page)]
    assert {"q [m]", "v [m/s]", "w [m/s]"} <= set(headings)


def test_a_result_without_inputs(result, tmp_path):
    page = written({"KF": result.drop_dims("input")}, tmp_path)
    assert "<h2>Inputs</h2>" not in page


def test_many_estimators_get_distinct_strokes(result, tmp_path):
    page = written({f"E{i}": result for i in range(8)}, tmp_path)
    assert "dashed var(--series-0)" in page


def test_long_recordings_stay_small_and_say_so(result, tmp_path):
    n = 25_000
    long = result.isel(time=np.arange(n) % 300).assign_coords(time=0.01 * np.arange(n))
    page = written({"a": long, "b": long}, tmp_path)
    assert "smallest and largest of every 25 samples" in page
    assert len(page.encode()) < 2.5e6
    assert "The plots show every sample." in written({"a": result}, tmp_path)


def test_no_result_is_refused(tmp_path):
    with pytest.raises(DataError, match="no results"):
        report({}, tmp_path / "report.html")


def test_folders_are_made(result, tmp_path):
    assert report({"KF": result}, tmp_path / "a" / "b.html").is_file()


def test_a_place_that_cannot_be_written_leaves_nothing_behind(result, tmp_path):
    (tmp_path / "file").write_text("here already")
    with pytest.raises(OutputError, match="cannot write"):
        report({"KF": result}, tmp_path / "file" / "report.html")
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(OutputError, match=r"folder\.html"):
        report({"KF": result}, tmp_path / "folder.html")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.html"]
    assert os.listdir(tmp_path / "folder.html") == []


def test_an_older_report_survives_a_failure(result, tmp_path, monkeypatch):
    place = tmp_path / "report.html"
    place.write_text("older")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        report({"KF": result}, place)
    assert place.read_text() == "older"
    assert os.listdir(tmp_path) == ["report.html"]


def test_the_first_screen_is_the_answer(result, tmp_path):
    known = result.assign_coords(state_role=("state", ["motion", "unknown"]))
    page = written({"KF": known, "twin": known}, tmp_path, reference={"v": 0.0})
    header = page[page.index("<header>") : page.index("</header>")]
    assert re.findall(r"<h3>.*?</i>(\w+)", header) == ["v"]
    last = float(result.x_hat[-1, 1])
    shown = re.search(r'class="value">\(?(−?[\d.]+)', header)[1].replace("−", "-")
    assert float(shown) == pytest.approx(last, rel=0.5)
    assert header.count("<svg") == 1
    # Both say the same: once.
    assert header.count("consistent, its innovations are as large as it predicts") == 1
    assert header.count('class="lamp good"') == 2
    assert page.index("<h2>Unknowns</h2>") < page.index("<h2>States</h2>")
    assert page.index("<h2>Innovations</h2>") < page.index("<h2>Comparison</h2>")


def test_a_lamp_tells_who_is_not_to_be_believed(filtered, tmp_path):
    narrow = filtered(600, noise_factor=0.2)
    header = written({"narrow": narrow}, tmp_path).partition("</header>")[0]
    assert 'class="lamp bad"' in header
    assert 'class="lamp fair"' in written({"wide": filtered(600, noise_factor=5.0)}, tmp_path)
