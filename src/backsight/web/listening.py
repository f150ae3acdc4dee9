"""A socket that is ready for a server, and the secret of its addresses."""

import contextlib
import secrets
import socket
from collections.abc import Iterator
from pathlib import Path

from backsight.errors import OutputError
from backsight.output import write_whole

HERE = "127.0.0.1"


@contextlib.contextmanager
def listening_on(host: str, port: int) -> Iterator[socket.socket]:
    """Give a socket that listens; port 0 is any that is free.

    Raises
    ------
    OutputError
        If the port is taken, or the address is none of this computer.
    """
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((host, port))
            listening.listen()  # a browser that is faster than the server waits
        except OSError as error:
            raise OutputError(
                f"{host}:{port} cannot be used: {error.strerror or error}; leave the port out to "
                "take a free one"
            ) from None
        yield listening


def token_of(file: Path | None) -> str:
    """Return a secret; with a file, the one in it, which only this user may read.

    Raises
    ------
    OutputError
        If the file cannot be read or written, or holds no secret.
    """
    if file is None:
        return secrets.token_urlsafe(24)
    try:
        if not file.exists():
            write_whole(file, secrets.token_urlsafe(24).encode(), mode=0o600)
        token = file.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise OutputError(f"cannot use the token in '{file}': {error}") from None
    if len(token) < 20 or not all(c.isalnum() or c in "-_" for c in token):
        raise OutputError(
            f"'{file}' holds no token: 20 or more letters, digits, - and _; remove it for a new one"
        )
    return token
