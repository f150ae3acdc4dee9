"""Commands that are cut off, on disks that break or fill up: the old results or the new, whole."""

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from faulty_disk import Disk, builds_faults, commands, files
from tests.extensions.distributions import install
from tests.fleet.springs import write_fleet
from tests.problem.test_in_parts import divided

import small_problem
from backsight.output import MARKER, write_whole
from backsight.problem import load, run_problem

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not builds_faults(), reason="needs Linux and gcc"),
]

MOST = 12
"""Steps of a command that are tried for each fault; of files alone every one is, elsewhere."""

CHANGING = ("summary.json", "estimates.nc", "report.html")
"""Files that hold the time that was taken."""


@dataclasses.dataclass(frozen=True)
class Verb:
    """A command that writes a folder.

    Parameters
    ----------
    prepare : callable
        Writes what the command reads into a folder; the text says which version.
    command : callable
        The words of the command line.
    """

    prepare: Callable[[Path, str], object]
    command: Callable[[Path, Path], list[object]]


def problem(folder: Path, version: str) -> None:
    text = small_problem.changed("Mass on", f"{version} mass on")
    noise = {"Old": "1e-4", "New": "2e-4"}[version]
    small_problem.write(folder, text.replace("y = 1e-4", f"y = {noise}"))


def estimates(folder: Path, version: str) -> None:
    problem(folder, version)
    run_problem(load(folder / "problem.toml"), folder / "ran", progress=lambda *_: None)


def played(folder: Path, version: str) -> None:
    only = small_problem.TEXT.partition("[estimators.MHO]")[0]
    small_problem.write(folder, only + REPLAYED)


REPLAYED = """
[live]
[source.rig]
kind = "replay"
speed = 0
[store]
path = "results/out"
every = 0.05
"""

STUDY = """
from pathlib import Path
from backsight_studies.checks import Check
from backsight_studies.study import Study, Written

def write(version, folder):
    (folder / "table.csv").write_text(version * 5000)
    (folder / "figure.svg").write_text(f"<svg>{version}</svg>")
    check = Check("speed", 1.0, 1.0, 0.1, True, "table.csv")
    return Written([check], f"<p>{version}</p>", [version])

STUDY = Study(
    "springs", "Springs", lambda *_: (Path(__file__).parent / "version").read_text(), write
)
"""

VERBS = {
    "run": Verb(problem, lambda here, out: ["run", here / "problem.toml", "-o", out]),
    "export": Verb(
        problem, lambda here, out: ["export", here / "problem.toml", "-e", "EKF", "-o", out]
    ),
    "tune": Verb(
        problem,
        lambda here, out: [
            *("tune", here / "problem.toml", "-e", "EKF", "-o", out / "tuned.toml"),
            *("--page", out / "page.html", "--force"),
        ],
    ),
    "report": Verb(
        estimates,
        lambda here, out: ["report", here / "ran" / "estimates.nc", "-o", out / "page.html"],
    ),
    "fleet": Verb(
        lambda folder, version: write_fleet(folder, count=3),
        lambda here, out: ["fleet", here / "fleet.toml", "-o", out, "--workers", 0],
    ),
    "study": Verb(
        lambda folder, version: (folder / "version").write_text(version),
        lambda here, out: ["study", "run", "springs", "-o", out],
    ),
    "live": Verb(
        played,
        lambda here, out: ["live", here / "problem.toml"],
    ),
    "parts": Verb(
        lambda folder, version: divided(folder) if not (folder / "parts").exists() else None,
        lambda here, out: ["run", here / "problem.toml", "-o", out],
    ),
}

GOES_ON = ("fleet", "parts", "live")
"""What is finished is kept, and the rest is done by the next start."""

SEPARATE = ("tune",)
"""Each of its files is old or new for itself."""


@pytest.fixture(scope="module", params=VERBS)
def place(request, tmp_path_factory):
    """A folder with what is read, one that is written to, and what runs the command."""
    here = tmp_path_factory.mktemp(request.param)
    if request.param == "study":
        install(
            here, "springs", {"springs_study": STUDY}, studies={"springs": "springs_study:STUDY"}
        )
    with commands(here) as run:
        yield Place(request.param, VERBS[request.param], here, run)


@dataclasses.dataclass
class Place:
    name: str
    verb: Verb
    here: Path
    run: object

    def __post_init__(self):
        self.out, self.old = self.here / "results" / "out", self.here / "old"
        self.out.parent.mkdir()
        self.verb.prepare(self.here, "Old")
        self.words = self.verb.command(self.here, self.out)
        self.run.warm(*self.words)
        if self.name in GOES_ON:
            self.finished = self.facts()
            shutil.rmtree(self.out)
            self.out.mkdir()
        shutil.copytree(self.out, self.old)
        self.before = self.contents()
        if self.name not in GOES_ON:
            self.verb.prepare(self.here, "New")
        self.again()
        whole = self.start()
        assert whole.code in (0, 1), whole.told
        self.trace = whole.trace
        self.after = self.contents()
        if self.name not in GOES_ON:
            assert self.after != self.before
        else:
            assert self.facts() == self.finished

    def again(self):
        """Put the old results back."""
        shutil.rmtree(self.out.parent)
        shutil.copytree(self.old, self.out)

    def start(self, **fault):
        return self.run(*self.words, under=self.out.parent, **fault)

    def contents(self):
        """What is there of every file; of those with times in them, which version it is."""
        found = {n: t for n, t in files(self.out).items() if n != MARKER}
        for name in found:
            if Path(name).name in CHANGING or name.endswith(".html"):
                versions = [v for v in (b"Old mass", b"New mass") if v in found[name]]
                found[name] = b" ".join(versions) if versions else found[name][:0]
        return found

    def facts(self):
        """The numbers of a store, however often it was begun."""
        if self.name == "live":
            return pd.read_parquet(self.out).to_csv()
        if self.name == "fleet":
            return pd.read_csv(self.out / "rows.csv").to_csv()
        told = json.loads((self.out / "summary.json").read_text())
        return json.dumps(told), sorted(p.name for p in (self.out / "parts" / "EKF").glob("p*"))

    def check(self):
        """Whether what is there is the old or the new, and how it goes on."""
        if self.name in GOES_ON:
            done = self.start()
            assert done.code in (0, 1), done.told
            assert self.facts() == self.finished
        else:
            write_whole(self.out / "z", b"")  # whoever writes there next
            (self.out / "z").unlink()
            found = self.contents()
            if self.name in SEPARATE:
                assert found.keys() <= self.after.keys()
                assert all(t in (self.before.get(n), self.after[n]) for n, t in found.items())
            else:
                assert found in (self.before, self.after)
        write_whole(self.out.parent / "z", b"")
        assert sorted(p.name for p in self.out.parent.iterdir()) == ["out", "z"]
        assert not [n for n in files(self.out) if ".part" in n]


def chosen(trace: str, kind: str) -> list[int]:
    """Steps from first to last; others for other faults. Few of the many writes are among them."""
    first = {letter: trace.index(letter) for letter in trace}
    steps = [k for k, letter in enumerate(trace) if letter != "W" or k == first[letter]]
    shift = ["kill", "interrupt", "broken"].index(kind)
    return sorted({*steps[shift :: max(len(steps) // MOST, 1)], *first.values()})


@pytest.mark.parametrize("kind", ["kill", "interrupt", "broken"])
def test_a_fault_at_a_step(place, kind):
    for k in chosen(place.trace, kind):
        place.again()
        done = place.start(kind=kind, at=k)
        assert "Traceback" not in done.told, done.told
        assert len(done.told) < 2000
        if kind != "kill":
            assert done.code in (0, 1, {"interrupt": 130, "broken": 2}[kind]), done.told
            # SQLite does not say why, and a fault of one moment is gone when it is looked for.
            words = "Input/output error", "unable to open database file"
            assert done.code != 2 or any(reason in done.told for reason in words)
        place.check()


def test_a_full_disk(place):
    room, full = 0, 0
    while True:
        place.again()
        done = place.start(kind="full", at=room)
        assert "Traceback" not in done.told, done.told
        assert not [n for n in files(place.out.parent) if ".part" in n]
        whole = "No space left" not in done.told if place.name == "live" else done.code in (0, 1)
        if whole:
            break
        assert done.code == 2 or (place.name == "live" and done.code == 1)
        full += 1
        assert "No space left" in done.told or "full" in done.told, done.told
        place.check()
        room = 100 + 4 * room
    assert full > 3


@pytest.mark.parametrize("kind", ["kill", "interrupt", "broken", "full"])
def test_what_is_kept_may_be_on_a_bad_disk(kind, tmp_path, monkeypatch):
    """`check` writes nothing but compiled programs: it does without them."""
    monkeypatch.setenv("BACKSIGHT_CACHE", str(tmp_path / "cache"))
    words = "check", small_problem.write(tmp_path)
    (tmp_path / "cache").mkdir()
    with commands(tmp_path) as run:
        run.warm("methods")
        whole = run(*words, under=tmp_path / "cache")
        for at in [0, 1, 100] if kind == "full" else range(0, len(whole.trace), 2):
            shutil.rmtree(tmp_path / "cache")
            (tmp_path / "cache").mkdir()
            done = run(*words, under=tmp_path / "cache", kind=kind, at=at)
            assert "Traceback" not in done.told, done.told
            if kind in ("broken", "full"):
                assert (done.code, done.printed) == (whole.code, whole.printed)
            if kind == "interrupt":
                assert done.code in (whole.code, 130)
            again = run(*words, under=tmp_path / "cache")
            assert (again.code, again.printed) == (whole.code, whole.printed)


def test_a_power_cut(place, tmp_path):
    place.again()
    shutil.copytree(place.out.parent, tmp_path / "before")
    (tmp_path / "log").mkdir()
    assert place.start(log=tmp_path / "log").code in (0, 1)
    cut = Disk(tmp_path / "before", place.out.parent, tmp_path / "log")
    for each in cut.cuts(every=max(len(cut.entries) // MOST, 1)):
        cut.build(each, place.out.parent)
        place.check()
