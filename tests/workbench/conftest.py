"""A workbench that is served, and what asks it."""

import contextlib
import dataclasses
import http.client
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from backsight.workbench._bench import Workbench
from backsight.workbench.serving import ready_to_serve

ROOT = Path(__file__).parents[2]
MOTOR = ROOT / "examples" / "motor" / "motor.csv"


@dataclasses.dataclass(frozen=True)
class Served:
    """A workbench and its address."""

    bench: Workbench
    address: str

    def raw(
        self, method: str, path: str, body: bytes = b"", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Ask for an address as it stands; return status, headers and body."""
        place = urlsplit(self.address)
        connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=60)
        with contextlib.closing(connection):
            connection.request(method, path, body, {"Host": place.netloc} | headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    def ask(self, path: str, given: Any = None, method: str = "") -> Any:
        """Ask as the page does; return what it is answered."""
        body = given if isinstance(given, bytes) else json.dumps(given or {}).encode()
        method = method or ("GET" if given is None else "POST")
        status, _, answer = self.raw(method, urlsplit(self.address).path + path, body)
        found = json.loads(answer)
        assert (status == 200) == ("error" not in found or path == "check"), found
        return found

    def finished(self) -> dict[str, Any]:
        """Wait for the last run."""
        end = time.monotonic() + 120
        while (run := self.ask("runs")[-1])["state"] == "running":
            assert time.monotonic() < end
            time.sleep(0.05)
        return run


@contextlib.contextmanager
def serving(bench: Workbench) -> Iterator[Served]:
    """Serve until the block ends."""
    with ready_to_serve(bench) as (server, listening, address):
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield Served(bench, address)
        finally:
            server.should_exit = True
            thread.join()
            bench.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[Served]:
    """A workbench without a recording."""
    with serving(Workbench(tmp_path_factory.mktemp("bench"))) as found:
        yield found
