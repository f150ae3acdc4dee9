"""Serve the dashboard beside a run, in a thread."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from backsight.errors import OutputError, PluginError
from backsight.live._session import LiveSession
from backsight.live._status import LiveStatus
from backsight.live.dashboard._board import Board
from backsight.live.dashboard._saving import Recent
from backsight.problem.reading.tables import DashboardTable
from backsight.web.listening import HERE, listening_on, token_of


@contextlib.contextmanager
def served_board(
    session: LiveSession,
    status: LiveStatus,
    table: DashboardTable,
    *,
    tell: Callable[[str], None],
) -> Iterator[tuple[Board, str]]:
    """Serve the dashboard of a run until the block ends; give the board and its address.

    Raises
    ------
    OutputError
        If the port is taken, or a certificate cannot be used.
    PluginError
        If the server is not installed.
    """
    try:
        import uvicorn

        from backsight.live.dashboard._application import dashboard_application
    except ModuleNotFoundError as error:
        raise PluginError(
            f"the dashboard needs {error.name}: pip install 'backsight[live]'"
        ) from None
    folder = session.live.problem.path.parent
    token = token_of(None if table.token_file is None else folder / table.token_file)
    recent = Recent(
        session.live, session.grid.dt, folder=folder / table.saved, minutes=table.minutes
    )
    board = Board(session, status, recent)
    with listening_on(table.host, table.port) as listening:
        port = listening.getsockname()[1]
        here = table.host == HERE
        hosts = [f"{HERE}:{port}", f"localhost:{port}"] if here else None
        config = uvicorn.Config(
            dashboard_application(board, token=token, hosts=hosts),
            log_level="error",
            access_log=False,  # addresses hold the token
            server_header=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=1,
            ssl_certfile=_file(folder, table.certificate),
            ssl_keyfile=_file(folder, table.key),
        )
        _check_certificate(config, table)
        server = uvicorn.Server(config)
        thread = threading.Thread(
            target=server.run, kwargs={"sockets": [listening]}, name="dashboard", daemon=True
        )
        thread.start()
        scheme = "https" if table.certificate else "http"
        address = f"{scheme}://{table.host}:{port}/{token}/"
        tell(f"the dashboard is at {address}")
        if not here and not table.certificate:
            tell("others on the network can read what the dashboard sends: give it a certificate")
        try:
            yield board, address
        finally:
            server.should_exit = True
            thread.join(5.0)


def _file(folder: Path, name: str | None) -> str | None:
    return None if name is None else str(folder / name)


def _check_certificate(config: object, table: DashboardTable) -> None:
    """Raise `OutputError` if the certificate cannot be used; the server would end the process."""
    if (table.certificate is None) != (table.key is None):
        raise OutputError("dashboard: give both certificate and key, or neither")
    if table.certificate is None:
        return
    import ssl

    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(config.ssl_certfile, config.ssl_keyfile)  # type: ignore[attr-defined]
    except (OSError, ssl.SSLError) as error:
        raise OutputError(f"dashboard.certificate: cannot be used: {error}") from None
