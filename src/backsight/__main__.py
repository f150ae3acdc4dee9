"""``backsight`` and ``python -m backsight`` are the command line."""

import sys


def command_line() -> None:
    """Run the command line; an interrupt before it has begun is no traceback."""
    try:
        from backsight.cli import app
    except KeyboardInterrupt:
        print("backsight: interrupted", file=sys.stderr)
        sys.exit(130)
    app(prog_name="backsight")


if __name__ == "__main__":
    command_line()
