"""``backsight`` and ``python -m backsight`` are the command line."""

import os
import sys


def command_line() -> None:
    """Run the command line; an interrupt before it has begun is no traceback."""
    _open_streams()
    try:
        from backsight.cli import app
    except KeyboardInterrupt:
        print("backsight: interrupted", file=sys.stderr)
        sys.exit(130)
    app(prog_name="backsight")


def _open_streams() -> None:
    """Give closed standard streams (``>&-``) to nobody.

    Python has None there, and the next file that is opened, a result, would get what is printed.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it takes the lowest number, which is this one
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115


if __name__ == "__main__":
    command_line()
