"""Estimates for others: every so often, as JSON, without making the estimator wait."""

import json
import socket

import pytest
from tests.live.conftest import COLUMNS, DT, fed, message
from tests.live.test_alarms import IN_ORDER

from backsight.errors import ProblemError


def test_datagrams_hold_the_estimates(tmp_path, samples, expected):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        port = receiver.getsockname()[1]
        sink = f'[sink.plc]\nkind = "udp"\nport = {port}\nevery = 0.5\nof = ["k", "y"]\n'
        with fed(tmp_path, IN_ORDER + COLUMNS + sink) as live:
            live.feed(map(message, samples[:300]))
        found = [json.loads(receiver.recv(65536)) for _ in range(5)]
    for one in found:
        k = round(one["t"] / DT)
        assert one["k"] == pytest.approx(float(expected["x_hat"].sel(state="k")[k]), rel=1e-12)
        assert one["k_std"] == pytest.approx(float(expected["x_std"].sel(state="k")[k]), rel=1e-12)
        assert set(one) == {"t", "k", "k_std", "y", "nis", "status"}
    assert [round(one["t"] - found[0]["t"], 6) for one in found] == [0, 0.5, 1, 1.5, 2]


def test_lines_of_every_sample(tmp_path, samples, capsys):
    sink = '[sink.out]\nkind = "stdout"\nevery = 0\n'
    with fed(tmp_path, IN_ORDER + COLUMNS + sink) as live:
        live.feed(map(message, samples[:200]))
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(lines) == 200
    assert {"q", "q_std", "v", "k"} <= set(lines[0])


def test_what_does_not_exist_is_said(tmp_path):
    sink = '[sink.out]\nkind = "stdout"\nof = ["kk"]\n'
    with pytest.raises(ProblemError, match="no quantity 'kk', did you mean 'k'"):  # noqa: SIM117
        with fed(tmp_path, IN_ORDER + COLUMNS + sink):
            pass
