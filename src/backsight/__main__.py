"""``backsight`` and ``python -m backsight`` are the command line."""

import os
import sys

LEAST_ADDRESSES = 1 << 30
"""Address space below which the numerical libraries do not come up [bytes]."""

ADDRESSES_PER_CORE = 64 << 20
"""What they take for each thread that they start [bytes]."""


def command_line() -> None:
    """Run the command line; an interrupt before it has begun is no traceback."""
    try:
        _open_streams()
        _refuse_little_memory()
        from backsight.cli import app
    except KeyboardInterrupt:
        print("backsight: interrupted", file=sys.stderr)
        sys.exit(130)
    app(prog_name="backsight")


def _open_streams() -> None:
    """Give a stream that the caller has closed a place to go to.

    The next file that is opened would take its number, and what a library prints would be in it.
    """
    for number, mode in enumerate("rww"):
        try:
            os.fstat(number)
        except OSError:
            # It gets the lowest free number, this one; processes that are started have it, too.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        name = ("stdin", "stdout", "stderr")[number]
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def _refuse_little_memory() -> None:
    """End with a sentence where a limit (``ulimit -v``) is too low for what is to be loaded.

    OpenBLAS asks for its buffers for ever where it gets none, in the middle of an import.
    """
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = LEAST_ADDRESSES + (os.cpu_count() or 1) * ADDRESSES_PER_CORE
    if limit != resource.RLIM_INFINITY and limit < needed:
        print(
            f"backsight: the limit of memory (ulimit -v) is {limit >> 20} MiB, and the numerical "
            f"libraries need {needed >> 20} MiB; raise it",
            file=sys.stderr,
        )
        sys.exit(2)


if __name__ == "__main__":
    command_line()
