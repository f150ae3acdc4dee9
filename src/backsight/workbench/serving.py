"""Serve the workbench on this computer, to one browser."""

import contextlib
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from backsight.errors import OutputError, PluginError
from backsight.workbench._bench import Workbench

if TYPE_CHECKING:
    import uvicorn

HERE = "127.0.0.1"


def open_workbench(
    file: Path | None,
    *,
    out: Path | None,
    port: int,
    browser: bool,
    tell: Callable[[str], None],
) -> None:
    """Serve the page until it is interrupted.

    Parameters
    ----------
    file : Path, optional
        Recording or problem file to begin with.
    out : Path, optional
        Folder that keeps recordings, problem files and results; a temporary one if not given.
    port : int
        0: any that is free.
    browser : bool
        Whether to open a browser.
    tell : callable
        Told the address.

    Raises
    ------
    DataError, ProblemError
        If the file cannot be read.
    OutputError
        If the folder cannot be made, or the port is taken.
    PluginError
        If the server is not installed.
    """
    with contextlib.ExitStack() as stack:
        bench = Workbench(_folder(stack, out))
        if file is not None:
            bench.open(file)
        server, listening, address = stack.enter_context(ready_to_serve(bench, port))
        stack.callback(bench.close)
        tell(f"The workbench is open at {address}\nEnd it with Ctrl-C.")
        if out is None:
            tell("Results are kept until then: save what you need, or say --out FOLDER.")
        if browser:
            webbrowser.open(address)
        server.run(sockets=[listening])


@contextlib.contextmanager
def ready_to_serve(
    bench: Workbench, port: int = 0
) -> Iterator[tuple["uvicorn.Server", socket.socket, str]]:
    """Give a server that is ready to run, the socket that it listens on, and its address."""
    try:
        import uvicorn

        from backsight.workbench._application import application
    except ModuleNotFoundError as error:
        raise PluginError(
            f"the workbench needs {error.name}: pip install 'backsight[open]'"
        ) from None
    token = secrets.token_urlsafe(24)
    with socket.socket() as listening:
        try:
            listening.bind((HERE, port))
            listening.listen()  # a browser that is faster than the server waits
        except OSError as error:
            raise OutputError(
                f"port {port} cannot be used: {error.strerror}; leave it out to take a free one"
            ) from None
        port = listening.getsockname()[1]
        app = application(bench, token=token, hosts=[f"{HERE}:{port}", f"localhost:{port}"])
        config = uvicorn.Config(
            app,
            log_level="critical",  # what a browser does is no news of the workbench
            access_log=False,  # addresses hold the token
            server_header=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=2,
        )
        yield uvicorn.Server(config), listening, f"http://{HERE}:{port}/{token}/"


def _folder(stack: contextlib.ExitStack, out: Path | None) -> Path:
    if out is None:
        return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="backsight-")))
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder '{out}': {error.strerror}") from None
    return out
