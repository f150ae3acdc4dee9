"""Serve the dashboard beside a run, in a thread."""

import contextlib
import dataclasses
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from backsight.errors import OutputError, PluginError
from backsight.live._session import LiveSession
from backsight.live._status import LiveStatus
from backsight.live.dashboard._board import Board
from backsight.live.dashboard._remembering import kept_history
from backsight.live.dashboard._saving import Recent
from backsight.problem.reading.tables import DashboardTable
from backsight.web.listening import HERE, listening_on, token_of


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a dashboard is found, before and after a run begins anew.

    Parameters
    ----------
    table : DashboardTable
    folder : Path
        Of the problem file.
    listening : socket.socket
    token : str
        Secret part of the address.
    """

    table: DashboardTable
    folder: Path
    listening: socket.socket
    token: str

    @property
    def port(self) -> int:
        """Port that is listened on."""
        return self.listening.getsockname()[1]

    @property
    def address(self) -> str:
        """What is opened in a browser."""
        scheme = "https" if self.table.certificate else "http"
        return f"{scheme}://{self.table.host}:{self.port}/{self.token}/"

    @property
    def hosts(self) -> list[str] | None:
        """Names by which it may be asked for; any on an address that others see."""
        if self.table.host != HERE:
            return None
        return [f"{HERE}:{self.port}", f"localhost:{self.port}"]

    def file(self, name: str | None) -> str | None:
        """A file beside the problem file."""
        return None if name is None else str(self.folder / name)


@contextlib.contextmanager
def placed_board(
    table: DashboardTable, folder: Path, *, tell: Callable[[str], None]
) -> Iterator[Place]:
    """Listen where the dashboard of a problem file in a folder shall be, and tell its address.

    Raises
    ------
    OutputError
        If the port is taken, or a certificate cannot be used.
    PluginError
        If the server is not installed.
    """
    try:
        import uvicorn  # noqa: F401

        import backsight.live.dashboard._application  # noqa: F401
    except ModuleNotFoundError as error:
        raise PluginError(
            f"the dashboard needs {error.name}: pip install 'backsight[live]'"
        ) from None
    token = token_of(None if table.token_file is None else folder / table.token_file)
    with listening_on(table.host, table.port) as listening:
        place = Place(table, folder, listening, token)
        _check_certificate(place)
        tell(f"the dashboard is at {place.address}")
        if place.hosts is None and not table.certificate:
            tell("others on the network can read what the dashboard sends: give it a certificate")
        yield place


@contextlib.contextmanager
def served_board(session: LiveSession, status: LiveStatus, place: Place) -> Iterator[Board]:
    """Serve the dashboard of a run until the block ends."""
    import uvicorn

    from backsight.live.dashboard._application import dashboard_application

    table = place.table
    recent = Recent(
        session.live, session.grid.dt, folder=place.folder / table.saved, minutes=table.minutes
    )
    board = Board(session, status, recent)
    config = uvicorn.Config(
        dashboard_application(board, token=place.token, hosts=place.hosts),
        log_level="critical",  # what a browser does is no news of the run
        access_log=False,  # addresses hold the token
        server_header=False,
        lifespan="off",
        ws="none",
        timeout_graceful_shutdown=1,
        ssl_certfile=place.file(table.certificate),
        ssl_keyfile=place.file(table.key),
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(
        target=server.run, kwargs={"sockets": [place.listening]}, name="dashboard", daemon=True
    )
    thread.start()
    store = None if session.keeper is None else session.keeper.store
    try:
        with kept_history(board.history, store, board.columns()):
            yield board
    finally:
        board.ended = True
        server.should_exit = True
        thread.join(5.0)


def _check_certificate(place: Place) -> None:
    """Raise `OutputError` if the certificate cannot be used; the server would end the process."""
    table = place.table
    if (table.certificate is None) != (table.key is None):
        raise OutputError("dashboard: give both certificate and key, or neither")
    if table.certificate is None:
        return
    import ssl

    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(str(place.file(table.certificate)), place.file(table.key))
    except (OSError, ssl.SSLError) as error:
        raise OutputError(f"dashboard.certificate: cannot be used: {error}") from None
