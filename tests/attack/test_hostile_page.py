"""Hostile names, units and titles in the report: text, and nothing else."""

import itertools
import json

import pytest
import xarray as xr

from attack.pages import CHROMIUM, Skeleton, drawn
from attack.payloads import CONTROLS, PAYLOADS, TRAP
from backsight.analysis.comparison import ALIGNMENT
from backsight.report import page as module
from backsight.report import report
from report.conftest import filtered
from report.unpacking import unpacked


def hostile(*texts: str) -> tuple[dict[str, xr.Dataset], dict[str, object]]:
    """Results in which everything has one of these names, and what the page takes beside."""
    place = itertools.count()

    def name() -> str:
        k = next(place)
        return f"{texts[k % len(texts)]}{k}"

    result = filtered(30, states=(name(), name()))
    result = result.assign_coords(
        output=[name(), name()],
        input=[name()],
        state_unit=("state", [name(), name()]),
        output_unit=("output", [name(), name()]),
        input_unit=("input", [name()]),
    )
    result["status"][3] = 1
    alignment = "".join(name().splitlines())
    result.attrs |= {"model": name(), "estimator": name(), ALIGNMENT: alignment}
    reference = {str(result["state"].values[0]): 1.0}
    more = {"problem": "".join(texts), "title": "".join(texts), "reference": reference}
    return {name(): result, name(): result}, more


def page(text: str, folder) -> str:
    results, more = hostile(text)
    return report(results, folder / "report.html", **more).read_text(encoding="utf-8")


@pytest.fixture
def without_library(monkeypatch):
    """Leave out the drawing library, which is megabytes to parse and always the same."""
    monkeypatch.setattr(module, "_plotly_js", lambda: "/* drawing */")


@pytest.fixture(scope="module")
def harmless(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_plotly_js", lambda: "/* drawing */")
        return Skeleton(page("q", tmp_path_factory.mktemp("harmless")))


TEXTS = [*PAYLOADS.values(), *CONTROLS.values()]


@pytest.mark.usefixtures("without_library")
@pytest.mark.parametrize("first", range(0, len(TEXTS), 6))
def test_a_name_adds_no_element_no_attribute_and_no_script(first, tmp_path, harmless):
    results, more = hostile(*TEXTS[first : first + 6])
    written = report(results, tmp_path / "report.html", **more).read_text(encoding="utf-8")
    found = Skeleton(written)
    assert found.elements == harmless.elements
    assert found.odd == harmless.odd == []
    assert found.scripts[0] == harmless.scripts[0]
    assert found.scripts[2] == harmless.scripts[2]
    data = unpacked(written, "figures")
    figures = json.loads(data, parse_constant=lambda c: pytest.fail(c))["figures"]
    shown = [a["text"] for f in figures for a in f["layout"].get("annotations", [])]
    shown += [t["name"] for f in figures for t in f["traces"] if "name" in t]
    assert not [s for s in shown if "<" in s or "%{" in s]


@pytest.mark.usefixtures("without_library")
def test_what_a_payload_would_do_is_seen_by_the_parser(tmp_path, harmless):
    """The test can fail: a page that forgot to escape is found out."""
    whole = page("q", tmp_path)
    assert (
        Skeleton(whole.replace("<h1>q", f"<h1>{PAYLOADS['image']}")).elements != harmless.elements
    )
    assert Skeleton(whole.replace("<h1>q", "<h1><!-- -->")).odd
    figures = whole.replace('"figures">', f'"figures">{PAYLOADS["end of script"]}')
    assert Skeleton(figures).elements != harmless.elements


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="looks at the page in Chromium where there is one")
def test_nothing_runs_in_a_browser(tmp_path):
    texts = [text for name, text in PAYLOADS.items() if name != "long"]
    results, more = hostile(*("".join(texts[k::14]) for k in range(14)))
    seen = drawn(report(results, tmp_path / "report.html", **more), tmp_path)
    root = seen[seen.index("<html") : seen.index("<head")]
    assert "data-trap" not in root
    body = Skeleton(seen)
    assert "svg" in [tag for tag, _ in body.elements]  # plots were drawn
    assert not [e for e in body.elements if e[0] in ("iframe", "object", "base", "animate")]
    links = [text.partition('"')[0] for text in seen.split("<a ")[1:] for text in [text[6:]]]
    assert all(link.startswith("#") for link in links)
    assert not [e for e in body.elements if {"onload", "onerror", "onfocus"} & set(e[1])]


@pytest.mark.usefixtures("without_library")
@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="looks at the page in Chromium where there is one")
def test_the_trap_springs_when_a_page_forgets(tmp_path):
    path = tmp_path / "report.html"
    path.write_text(page("q", tmp_path).replace("<h1>q", f"<h1>{PAYLOADS['image']}"), "utf-8")
    seen = drawn(path, tmp_path)
    assert 'data-trap="sprung"' in seen[seen.index("<html") : seen.index("<head")]
    assert TRAP in seen
