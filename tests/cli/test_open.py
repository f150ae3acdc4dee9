"""`backsight open`, as it is started."""

import os
import re
import signal
import subprocess
import sys
import urllib.request

from tests.workbench.conftest import MOTOR


def test_the_workbench_opens_with_a_recording_and_ends_with_an_interrupt(tmp_path):
    command = [sys.executable, "-u", "-m", "backsight", "open", MOTOR, "--no-browser"]
    with subprocess.Popen(
        [*command, "--out", tmp_path / "kept"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"no_proxy": "127.0.0.1"},
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        line = process.stdout.readline()
        (address,) = re.findall(r"http://127\.0\.0\.1:\d+/[\w-]+/", line)
        with urllib.request.urlopen(f"{address}state", timeout=30) as answer:
            assert b'"name":"motor.csv"' in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in (0, 130)
        assert "Traceback" not in process.stderr.read()
    assert (tmp_path / "kept").is_dir()


def test_what_cannot_be_opened_is_said_in_a_line(backsight, tmp_path):
    code, printed, told = backsight("open", tmp_path / "absent.csv", "--no-browser")
    assert (code, printed) == (2, "")
    assert "absent.csv" in told
    assert told.count("\n") == 1


def test_without_the_server_it_says_what_to_install(backsight, monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    code, _, told = backsight("open", "--no-browser")
    assert code == 2
    assert "pip install 'backsight[open]'" in told
