"""What surrounds a command fails: memory, pipes, folders that are read only, others at work."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.extensions.distributions import install
from tests.faults.test_commands_on_a_bad_disk import REPLAYED, STUDY
from tests.fleet.springs import write_fleet

import small_problem
from backsight.output import MARKER

pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs signals and limits of POSIX")

MANY = 20
HERE = {"OPENBLAS_NUM_THREADS": "1"}


def words(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "backsight", *map(str, arguments)]


def shell(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line of bash, in which BS is the command; its status is that of the command."""
    line = f"BS='{sys.executable} -m backsight'; {text}"
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, capture_output=True, text=True, env=os.environ | HERE
    )


@pytest.fixture
def here(tmp_path):
    one, _, rest = small_problem.TEXT.partition("[estimators.MHO]")
    small_problem.write(tmp_path, one + rest.partition("N = 5\n")[2])
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    "what",
    [
        *("methods | head -1", "schema | true", "check problem.toml | head -1"),
        *("columns spring.csv | true", "study list | head -1", "fleet fleet.toml -o out | true"),
    ],
)
def test_whoever_reads_may_go(here, what):
    write_fleet(here)
    done = shell(f"$BS {what}; echo ${{PIPESTATUS[0]}} >&2", here)
    *told, code = done.stderr.splitlines()
    assert not told
    assert code in ("0", "1")


@pytest.mark.slow
def test_a_result_is_there_though_nobody_reads(here):
    done = shell("$BS run problem.toml -o out | true; echo ${PIPESTATUS[0]} >&2", here)
    *told, code = done.stderr.splitlines()
    assert not told
    assert code in ("0", "1")
    assert json.loads((here / "out" / "summary.json").read_text())


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_terminal_that_takes_nothing_is_one_line(here):
    done = shell("$BS methods > /dev/full", here)
    assert done.returncode == 2
    assert done.stderr == "backsight: No space left on device\n"


@pytest.mark.slow
@pytest.mark.parametrize("stream", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_a_closed_stream_is_no_reason_to_fail(here, stream):
    done = shell(f"$BS run problem.toml -o out {stream}", here)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert (here / "out" / "report.html").exists()


@pytest.fixture
def heeded(name):
    """A signal that the command heeds: it inherits what the tests ignore, as under `nohup`."""
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)
    yield number
    signal.signal(number, before)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("SIGTERM", 143),
        pytest.param("SIGINT", 130, marks=pytest.mark.slow),
        pytest.param("SIGHUP", 129, marks=pytest.mark.slow),
    ],
)
def test_a_request_to_end_leaves_what_was_there(here, heeded, code):
    """It comes when the results are begun."""
    (here / "out").mkdir()
    with subprocess.Popen(
        words("run", "problem.toml", "-o", "out"),
        cwd=here, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env=os.environ | HERE,
    ) as process:  # fmt: skip
        end = time.monotonic() + 60
        while not list((here / "out").glob(".backsight-*.part")):
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.002)
        process.send_signal(heeded)
        _, told = process.communicate(timeout=60)
    assert process.returncode == code
    assert told.startswith("backsight: ")
    assert "interrupted" in told
    assert "Traceback" not in told
    left = {p.name for p in (here / "out").iterdir()}
    # An estimator that had finished is written, unless there is another interrupt.
    assert not left or MARKER in left


def limited(megabytes: int):
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    return limit


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not keep to the limit")
def test_a_limit_of_memory_is_told_before_anything_is_loaded():
    done = subprocess.run(
        words("--version"), capture_output=True, text=True, preexec_fn=limited(450)
    )
    assert done.returncode == 2
    assert "450 MiB" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not keep to the limit")
@pytest.mark.parametrize(
    "line",
    [
        "run problem.toml -o out",
        "check problem.toml",
        "tune problem.toml -e EKF -o out/t.toml",
        "export problem.toml -e EKF -o out",
        "report ran/estimates.nc -o out/page.html",
        "fleet fleet.toml -o out --workers 0",
        "live live.toml",
        "study run springs -o out",
    ],
)
def test_memory_runs_out(here, line):
    """With ever more of it, until it is enough: one line each time, and nothing is half done."""
    command, verb = words(*line.split()), line.split()[0]
    if verb == "report":
        assert not subprocess.run(words("run", "problem.toml", "-o", "ran"), cwd=here).returncode
    write_fleet(here)
    install(here, "springs", {"springs_study": STUDY}, studies={"springs": "springs_study:STUDY"})
    (here / "version").write_text("New")
    own = os.environ | HERE | {"PYTHONPATH": str(here)}
    (here / "live.toml").write_text((here / "problem.toml").read_text() + REPLAYED)
    codes = []
    for megabytes in (150, 250, 350, 450, 550, 650, 800, 1000, 1300, 1700, 2200, 3000, 4000, 8000):
        shutil.rmtree(here / "out", ignore_errors=True)
        done = subprocess.run(
            command, cwd=here, capture_output=True, text=True, env=own,
            preexec_fn=limited(megabytes),
        )  # fmt: skip
        codes.append(done.returncode)
        assert "Traceback" not in done.stderr, (megabytes, done.stderr)
        if done.returncode == 0:
            break
        if verb not in ("fleet", "live"):  # what they go on from is there from the beginning
            assert not (here / "out").exists()
        assert not list(here.glob(".*part"))
    assert codes[-1] == 0


@pytest.mark.skipif(os.geteuid() == 0 and not shutil.which("setpriv"), reason="needs setpriv")
@pytest.mark.slow
@pytest.mark.parametrize("out", ["out", "out/new"])
def test_folders_that_are_read_only(here, out):
    """Also for who owns the computer, without the right to write everywhere."""
    (here / "out").mkdir()
    (here / "out").chmod(0o555)
    plain = ["setpriv", "--bounding-set=-dac_override"] if os.geteuid() == 0 else []
    done = subprocess.run(
        [*plain, *words("run", "problem.toml", "-o", out)],
        cwd=here, capture_output=True, text=True, env=os.environ | HERE,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        f"backsight: cannot write to the folder '{out}': Permission denied; choose another one\n"
    )
    assert not list((here / "out").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("out", ["one folder", "their own"])
def test_many_runs_at_once(here, out, tmp_path_factory):
    """Twenty of them, on one cache that is empty: the same numbers, and nothing is left over."""
    cache = tmp_path_factory.mktemp("cache")
    names = ["out"] * MANY if out == "one folder" else [f"out{k}" for k in range(MANY)]
    own = os.environ | HERE | {"BACKSIGHT_CACHE": str(cache)}
    running = [
        subprocess.Popen(
            words("run", "problem.toml", "-o", name),
            cwd=here, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=own,
        )
        for name in names
    ]  # fmt: skip
    for process in running:
        _, told = process.communicate()
        assert (process.returncode, told) == (0, "")
    finals = {
        json.dumps(
            json.loads((here / n / "summary.json").read_text())["estimators"]["EKF"]["final"]
        )
        for n in names
    }
    assert len(finals) == 1
    for name in set(names):
        there = sorted(p.name for p in (here / name).iterdir())
        assert there == [MARKER, "estimates.nc", "report.html", "summary.json"]
    assert not list(here.glob(".*part"))
    assert not list(cache.rglob("*.tmp"))
