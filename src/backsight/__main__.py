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
    """Let streams that were closed before the start take what is said, for nobody.

    Python has None in their place. Their numbers would go to the next files that are opened.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - to the end


if __name__ == "__main__":
    command_line()
