"""What zooming in brings out, the parts of many sensors, spectra, and a library beside the page."""

import base64
import json
import re

import numpy as np
import pytest

from backsight.report import _details, report
from backsight.report._details import Detail, thinning
from report.unpacking import figures_of, unpacked


def numbers(packed):
    data = base64.b64decode(packed["bdata"])
    if packed["dtype"] == "f4":
        return np.frombuffer(data, np.float32).astype(float)
    low, high = np.frombuffer(data, np.uint8).reshape(2, -1).astype(int)
    raw = np.cumsum(low + 256 * high) % 2**16
    return np.where(raw == 65535, np.nan, packed["low"] + packed["unit"] * raw)


def detail(*values, kind="line"):
    return Detail(kind, values, 0.0, 0.01, np.array([7], dtype=np.intp))


@pytest.fixture(scope="module")
def long(result):
    n = 6000
    noise = 0.01 * np.random.default_rng(0).standard_normal((n, 2))
    repeated = result.isel(time=np.arange(n) % 300).assign_coords(time=0.01 * np.arange(n))
    return repeated.assign(y_hat=repeated.y_hat + noise)


def test_a_long_page_has_every_sample_packed(long, tmp_path):
    page = report({"KF": long}, tmp_path / "r.html").read_text("utf-8")
    assert "zooming in brings out every sample" in page
    details = json.loads(unpacked(page, "details"))
    traces = {
        t["name"]: t
        for f in figures_of(page)
        if f["layout"]["annotations"][0]["text"] == "q_m [m]"
        for t in f["traces"]
        if t.get("yaxis") == "y" and "name" in t
    }
    (found,) = details[traces["KF"]["detail"]]["values"]
    exact = long.y_hat.sel(output="q_m").values
    np.testing.assert_allclose(numbers(found), exact, atol=np.ptp(exact) / 1e5)
    assert details[traces["KF"]["detail"]]["step"] == pytest.approx(0.01)


def test_short_recordings_need_no_details(result, tmp_path):
    page = report({"KF": result}, tmp_path / "r.html").read_text("utf-8")
    assert json.loads(unpacked(page, "details")) == []


def test_a_line_that_leaves_its_range_for_a_moment_keeps_its_digits():
    values = np.sin(np.arange(3000.0))
    values[5] = 1e9
    packed = detail(values).packed(1)["values"][0]
    assert packed["dtype"] == "f4"
    np.testing.assert_allclose(numbers(packed)[10:], values[10:], rtol=1e-6)


def test_missing_samples_are_missing():
    values = np.sin(np.arange(3000.0))
    values[100:200] = np.nan
    found = numbers(detail(values).packed(1)["values"][0])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(values))


def test_what_does_not_fit_is_thinned_to_its_peaks(monkeypatch):
    monkeypatch.setattr(_details, "ROOM", 3000)
    values = np.random.default_rng(1).standard_normal(5000)
    every = thinning([detail(values)], 0)
    thinned = detail(values).packed(every)
    found = numbers(thinned["values"][0])
    assert every > 1
    assert thinned["step"] == pytest.approx(0.01 * every / 2)
    assert len(found) == 2 * -(-5000 // every)
    tolerance = np.ptp(values) / 6e4
    assert found.max() == pytest.approx(values.max(), abs=tolerance)
    assert found.min() == pytest.approx(values.min(), abs=tolerance)


def test_a_full_page_has_no_room_for_details():
    values = np.random.default_rng(1).standard_normal(5000)
    assert thinning([detail(values)], _details.PAGE) > 1000


def test_a_thinned_band_covers():
    rng = np.random.default_rng(2)
    middle, half = rng.standard_normal(4000), rng.uniform(1, 2, 4000)
    thinned = detail(middle - half, middle + half, kind="band").packed(8)
    low, high = (np.repeat(numbers(v), 8)[:4000] for v in thinned["values"])
    tolerance = 1e-3
    assert (low <= middle - half + tolerance).all()
    assert (high >= middle + half - tolerance).all()


def test_many_sensors_have_a_part_each(result, tmp_path):
    copies = [result.y_hat.isel(output=[0]).assign_coords(output=[f"s{i}"]) for i in range(8)]
    names = [str(c.output.item()) for c in copies]
    picked = result.isel(output=[0] * 8)
    if "output_" in result.dims:
        picked = picked.isel(output_=[0] * 8).assign_coords(output_=names)
    many = picked.assign_coords(output=names)
    page = report({"KF": many}, tmp_path / "r.html").read_text("utf-8")
    assert re.findall(r'<details class="part"><summary>(\w+)</summary>', page) == names
    assert "<h2>Measured and estimated</h2>" not in page
    assert page.count("<figure") == len(figures_of(page))


def test_spectra_of_innovations_are_about_one(result, filtered, tmp_path):
    page = report({"KF": filtered(2000)}, tmp_path / "r.html").read_text("utf-8")
    spectra = [f for f in figures_of(page) if f["over"] == "frequency"]
    assert [f["layout"]["xaxis"]["title"]["text"] for f in spectra] == ["frequency [Hz]"] * 2
    for figure in spectra:
        y = figure["traces"][0]["y"]
        density = np.frombuffer(base64.b64decode(y["bdata"]), np.float32)
        assert 0.8 < np.mean(density) < 1.25


def test_pages_of_a_folder_share_the_library(result, tmp_path):
    for name in ("a.html", "b.html"):
        report({"KF": result}, tmp_path / name, library="beside")
    (shared,) = tmp_path.glob("*.js")
    page = (tmp_path / "b.html").read_text("utf-8")
    assert f'<script src="{shared.name}"></script>' in page
    assert 'id="plotly"' not in page
    assert len(page) < 300_000
    assert "script-src 'unsafe-inline' 'self' file:;" in page
