import json

import pytest

from backsight.errors import DataError, OutputError
from backsight_studies import STUDIES
from backsight_studies.checks import Check
from backsight_studies.study import Study, Written, from_seeds

MET = Check("speed", 1.0, float("nan"), 0.1, True, "speeds.csv")


def write(experiment, folder):
    (folder / "seeds.csv").write_text(str(experiment))
    return Written([MET], "<p>page</p>", ["one", "two"])


def own(carry_out=lambda seeds, recordings, progress: (seeds, recordings), writing=write):
    return Study("own", "Title", carry_out, writing, seeds=2)


def test_everything_is_written_and_told(tmp_path):
    told = []
    findings = own().run(
        tmp_path / "out", recordings=["a"], progress=lambda *what: told.append(what)
    )
    read = {p.name: p.read_text() for p in (tmp_path / "out").iterdir()}
    assert read["seeds.csv"] == "((0, 1), ['a'])"
    assert read["study.html"] == "<p>page</p>"
    assert json.loads(read["checks.json"])[0]["measured"] is None
    assert findings.page == tmp_path / "out" / "study.html"
    assert findings.checks == (MET,)
    assert str(findings) == "Title\n- one\n- two"
    assert told == [("", 1.0)]


def test_a_seed_counts_once(tmp_path):
    own().run(tmp_path / "out", seeds=[3, 1, 3])
    assert (tmp_path / "out" / "seeds.csv").read_text() == "((3, 1), ())"


def test_a_study_that_fails_leaves_nothing(tmp_path):
    def failing(experiment, folder):
        write(experiment, folder)
        raise DataError("no")

    with pytest.raises(DataError, match="no"):
        own(writing=failing).run(tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_found_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    began = own(carry_out=lambda *_: pytest.fail("it began"))
    with pytest.raises(OutputError):
        began.run(tmp_path / "file" / "out")


@pytest.mark.parametrize("name", STUDIES)
def test_no_study_takes_a_negative_seed(name, tmp_path):
    with pytest.raises(DataError, match=r"seeds \[0, -1\]: the study needs a seed that is not neg"):
        STUDIES[name].run(tmp_path / "out", seeds=(0, -1))
    assert not list(tmp_path.iterdir())


def test_a_simulation_needs_seeds_and_takes_no_recordings(tmp_path):
    study = own(carry_out=from_seeds(lambda seeds, _progress: seeds))
    with pytest.raises(DataError, match="takes no recordings"):
        study.run(tmp_path / "out", recordings=["a"])
    with pytest.raises(DataError, match=r"seeds \[\]: the study needs a seed"):
        study.run(tmp_path / "out", seeds=())
    study.run(tmp_path / "out", seeds=[5])
    assert (tmp_path / "out" / "seeds.csv").read_text() == "(5,)"
