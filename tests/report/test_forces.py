"""Maps of unknown forces and tables of hits, on the page and as a figure."""

import base64
import re

import numpy as np
import pytest

from backsight import plot
from backsight.errors import DataError
from backsight.report import report
from backsight.report.thin import peaks
from report.unpacking import figures_of

PLACES = ("tip", "<b>&middle", "root")
FORCES = {40: ("tip", -10.0), 41: ("tip", -5.0), 200: ("root", 4.0)}
"""The first two are one hit."""


def forced(result, given, *, positions=(0.4, 0.2, 0.1), places=PLACES, std=0.1):
    d_hat = np.zeros((result.sizes["time"], len(places)))
    for k, (name, force) in given.items():
        d_hat[k, places.index(name)] = force
    made = result.assign(
        d_hat=(("time", "force"), d_hat), d_std=(("time", "force"), std * (d_hat != 0))
    ).assign_coords(force=list(places), force_unit=("force", ["N"] * len(places)))
    return (
        made if positions is None else made.assign_coords(force_position=("force", list(positions)))
    )


def page(results, folder):
    return report(results, folder / "report.html").read_text(encoding="utf-8")


def maps(text):
    return [f for f in figures_of(text) if f["traces"][0]["type"] == "heatmap"]


def values(given):
    numbers = np.frombuffer(base64.b64decode(given["bdata"]), given["dtype"])
    return numbers.reshape([int(n) for n in given["shape"].split(", ")])


def rows(text):
    table = re.search(r'<table class="hits">.*?</table>', text, re.DOTALL)[0]
    cells = [re.findall("<td>(.*?)</td>", row) for row in table.split("<tr>")]
    return [row for row in cells if row]


def test_the_map_has_every_force_at_its_place_and_time(result, tmp_path):
    made = forced(result, FORCES)
    (drawn,) = maps(page({"A": made}, tmp_path))
    heat, circles = drawn["traces"]
    assert heat["y"] == ["tip (0.4)", "&lt;b&gt;&amp;middle (0.2)", "root (0.1)"]
    shown = np.nan_to_num(values(heat["z"]))
    np.testing.assert_array_equal(shown, made["d_hat"].values.T)
    dt, time = made.attrs["dt"], made["time"].values
    # Cells are given by their middle: the force acts from its sample to the next one.
    assert heat["x0"] + 40 * heat["dx"] == pytest.approx(time[40] + dt / 2)
    assert heat["zmax"] == -heat["zmin"] == 10.0
    assert circles["y"] == ["tip (0.4)", "root (0.1)"]
    assert circles["marker"]["size"][0] > circles["marker"]["size"][1]
    titles = [a["text"] for a in drawn["layout"]["annotations"]]
    assert titles[0] == "A: force [N] over place (position [m])"


def test_places_without_positions_have_their_names(result, tmp_path):
    (drawn,) = maps(page({"A": forced(result, FORCES, positions=None)}, tmp_path))
    assert drawn["traces"][0]["y"] == ["tip", "&lt;b&gt;&amp;middle", "root"]
    assert drawn["layout"]["annotations"][0]["text"] == "A: force [N] over place"


def test_the_table_has_the_largest_hits_with_their_deviations(result, tmp_path):
    text = page({"A": forced(result, FORCES | {100: (PLACES[1], 3.0)})}, tmp_path)
    assert rows(text) == [
        ["1", "tip (0.4)", "0.408333", "−10.00 ± 0.10", "−0.1500 ± 0.0014", "20.0"],
        ["2", "root (0.1)", "2.005", "4.00 ± 0.10", "0.0400 ± 0.0010", "10.0"],
        ["3", "&lt;b&gt;&amp;middle (0.2)", "1.005", "3.00 ± 0.10", "0.0300 ± 0.0010", "10.0"],
    ]
    assert "all hits, the largest impulse first" in text


def test_of_many_hits_only_the_largest_are_shown(result, tmp_path):
    many = {3 * k: ("tip", 1.0 + k) for k in range(40)}
    text = page({"A": forced(result, many)}, tmp_path)
    assert [row[3] for row in rows(text)] == [f"{40 - k}.00 ± 0.10" for k in range(12)]
    assert "12 largest of 40 hits" in text
    assert len(maps(text)[0]["traces"][1]["y"]) == 12


def test_without_a_force_there_is_a_sentence_and_no_map(result, tmp_path):
    lost = forced(result, {}).assign(
        d_raw=result["status"] * 0.0, nonzeros=result["status"] * 0.0, lam_max=result["status"] + 70
    )
    text = page({"A": lost, "B": forced(result, {})}, tmp_path)
    assert maps(text) == []
    assert "no force was found in the whole recording: lam is at or above lambda_max = 70" in text
    assert "no force is larger than chance would make it" in text
    assert '<table class="hits">' not in text


def test_estimators_without_forces_get_no_section(result, tmp_path):
    assert "Unknown forces" not in page({"KF": result}, tmp_path)
    assert len(maps(page({"KF": result, "A": forced(result, FORCES)}, tmp_path))) == 1


def test_long_recordings_keep_every_hit():
    d = np.zeros((10_003, 2))
    d[1234, 0], d[1235, 0], d[10_002, 1] = 1.0, -7.0, 3.0
    kept, length = peaks(d, 400)
    assert len(kept) <= 400
    assert kept[1235 // length, 0] == -7.0
    assert kept[-1, 1] == 3.0
    assert np.count_nonzero(kept) == 2
    short, length = peaks(d[:10], 400)
    assert length == 1
    np.testing.assert_array_equal(short, d[:10])


def test_the_figure_has_its_labels_and_circles(result, tmp_path):
    made = plot.figure()
    axes = made.axes[0]
    plot.force_map(axes, forced(result, FORCES), name="A")
    assert axes.get_title(loc="left") == "A: force [N] over place (position [m])"
    assert [t.get_text() for t in axes.get_yticklabels()] == [
        "tip (0.4)",
        "<b>&middle (0.2)",
        "root (0.1)",
    ]
    np.testing.assert_allclose(
        axes.collections[0].get_offsets(), [[0.408333, 0], [2.005, 2]], atol=1e-5
    )
    plot.save(made, tmp_path / "map.png", dpi=50)
    with pytest.raises(DataError, match="no unknown forces 'd_hat'"):
        plot.force_map(plot.figure().axes[0], result, name="KF")
