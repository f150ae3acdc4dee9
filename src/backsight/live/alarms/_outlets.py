"""Where alarms go beside the log: a program, an address on the web, a broker."""

import concurrent.futures
import contextlib
import json
import subprocess
from collections.abc import Callable, Mapping
from typing import Any

from backsight.live._publishing import Publisher
from backsight.problem.reading.tables import AlarmTable

PATIENCE = 10.0
"""Seconds that a program or an address may take."""

MOST_WAITING = 100
"""Alarms that may wait to be sent; beyond that they are in the log only."""


class Outlets:
    """Sends alarms without making the estimator wait.

    Parameters
    ----------
    tables : dict
        Alarms by name.
    tell : callable
        Told what could not be sent.

    Raises
    ------
    PluginError
        If a package is not installed.
    """

    def __init__(self, tables: Mapping[str, AlarmTable], tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._brokers = {n: Publisher(t.mqtt) for n, t in tables.items() if t.mqtt is not None}
        self._pool = concurrent.futures.ThreadPoolExecutor(2, "alarm")
        self._sending: list[concurrent.futures.Future[None]] = []

    def send(self, name: str, table: AlarmTable, event: Mapping[str, Any]) -> None:
        """Send an event to all who asked for it."""
        self._sending = [f for f in self._sending if not f.done()]
        if len(self._sending) >= MOST_WAITING:
            self._tell(f"alarm {name}: too many wait to be sent")
            return
        content = json.dumps(event).encode()
        if table.command:
            self._sending.append(self._pool.submit(self._run, name, table.command, content))
        if name in self._brokers:
            sent = self._brokers[name].publish(content, qos=1)
            self._sending.append(self._pool.submit(self._confirm, name, sent))
        if table.webhook:
            self._sending.append(self._pool.submit(self._post, name, table.webhook, content))

    def _run(self, name: str, command: list[str], content: bytes) -> None:
        try:
            done = subprocess.run(command, input=content, timeout=PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            self._tell(f"alarm {name}: cannot run {command[0]}: {error}")
            return
        if done.returncode:
            self._tell(f"alarm {name}: {command[0]} ended with {done.returncode}")

    def _confirm(self, name: str, sent: Any) -> None:
        """See whether the broker has it; else the connection keeps it until it has."""
        there = False
        with contextlib.suppress(RuntimeError, ValueError):  # there was no connection
            sent.wait_for_publish(PATIENCE)
            there = sent.is_published()
        if not there:
            self._tell(f"alarm {name}: the broker does not answer; it is sent when it does")

    def _post(self, name: str, address: str, content: bytes) -> None:
        import urllib.request

        request = urllib.request.Request(
            address, content, {"Content-Type": "application/json"}, method="POST"
        )
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE):
                pass
        except (OSError, ValueError) as error:
            self._tell(f"alarm {name}: cannot send to {address}: {error}")

    def close(self) -> None:
        """Wait a moment for what is being sent, and give up the rest."""
        concurrent.futures.wait(self._sending, timeout=PATIENCE)
        self._pool.shutdown(wait=False, cancel_futures=True)
        for broker in self._brokers.values():
            broker.stop()
