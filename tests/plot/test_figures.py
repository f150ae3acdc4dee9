import subprocess
import sys

import numpy as np
import pytest

from backsight import plot
from backsight.errors import OutputError


def drawn():
    t = np.linspace(0.0, 1.0, 50)
    made = plot.figure(2)
    top, bottom = made.axes
    plot.band(top, t, np.sin(t), 0.1 + 0 * t, name="EKF", series=0)
    plot.truth(top, t, np.sin(t))
    plot.label(top, "q", "um")
    plot.legend(top)
    plot.line(bottom, t, t, name="MHO", series=7)
    plot.label(bottom, "ratio", x="time [s]")
    return made


def test_picture_is_written_whole(tmp_path):
    path = plot.save(drawn(), tmp_path / "figures" / "fig4.png", dpi=50)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [p.name for p in path.parent.iterdir()] == ["fig4.png"]


def test_labels_legend_and_band():
    top, bottom = drawn().axes
    assert top.get_title(loc="left") == "q [um]"
    assert bottom.get_title(loc="left") == "ratio"
    assert bottom.get_xlabel() == "time [s]"
    assert [t.get_text() for t in top.get_legend().get_texts()] == ["EKF", "truth"]
    edge = top.collections[0].get_paths()[0].vertices[:, 1]
    assert edge.max() == pytest.approx(np.sin(1.0) + 0.3)


def test_place_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        plot.save(drawn(), tmp_path / "file" / "a.png")


def test_nothing_global_is_touched():
    """In a fresh interpreter; to look at rcParams["backend"] would itself choose one."""
    code = (
        "import sys, matplotlib\n"
        "rc = matplotlib.rcParams\n"
        "style = lambda: {k: rc[k] for k in rc if k != 'backend'}\n"
        "before = style()\n"
        "from backsight import plot\n"
        "plot.figure()\n"
        "assert style() == before\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_page_does_not_need_matplotlib():
    code = "import sys, backsight.report; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_matplotlib_it_says_how_to_get_it():
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import backsight.report\n"
        "try:\n"
        "    import backsight.plot\n"
        "except ModuleNotFoundError as error:\n"
        "    assert error.name == 'matplotlib'\n"
        "    assert \"pip install 'backsight[plot]'\" in str(error)\n"
        "else:\n"
        "    raise SystemExit('imported')\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
