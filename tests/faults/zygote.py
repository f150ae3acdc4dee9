"""A process that has loaded everything and forks for every command: a fault costs no start.

Orders are lines of JSON: ``{"argv", "under", "kind", "at", "log", "said"}``. Files under `said` get
what the command prints. The answer is ``{"code", "trace"}``: the exit code (negative: the signal),
and a letter for each step if the process lived to tell.
"""

import ctypes
import json
import os
import sys
import traceback

from backsight.errors import OutputError
from backsight.output import whole

DISK = ctypes.CDLL(None)
DISK.disk_arm.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.c_long, ctypes.c_char_p]
DISK.disk_trace.restype = ctypes.c_char_p

KINDS = ("nothing", "kill", "interrupt", "broken", "full")


def write(out: str, *texts: str) -> int:
    """Write files of one letter each: the smallest of all results."""
    try:
        with whole(out, names=[text[0] for text in texts]) as folder:
            for text in texts:
                (folder / text[0]).write_text(text)
    except OutputError as error:
        print(f"backsight: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        print("backsight: interrupted", *getattr(interrupt, "__notes__", ()), file=sys.stderr)
        return 130
    return 0


def command(argv: list[str]) -> int:
    """Run the command line as a program would; its exit code."""
    try:
        if argv[0] == "write":
            return write(*argv[1:])
        from backsight.cli import app  # once it is asked for: a small process forks quickly

        app(argv, prog_name="backsight")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def child(order: dict, answer: int) -> int:
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{order['said']}.{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    log = order["log"].encode() if order["log"] else None
    DISK.disk_arm(order["under"].encode(), KINDS.index(order["kind"]), order["at"], log)
    code = command(order["argv"])
    sys.stdout.flush()
    sys.stderr.flush()
    trace = DISK.disk_trace()
    DISK.disk_arm(b"", 0, 0, None)
    os.write(answer, trace)
    return code


def main() -> None:
    for line in sys.stdin:
        order = json.loads(line)
        if "warm" in order:
            silent = os.open(os.devnull, os.O_WRONLY)
            kept = os.dup(1)
            os.dup2(silent, 1)
            code, trace = command(order["warm"]), b""
            os.dup2(kept, 1)
        else:
            there, here = os.pipe()
            process = os.fork()
            if not process:
                os.close(there)
                try:
                    os._exit(child(order, here) & 255)
                except BaseException:
                    traceback.print_exc()
                os._exit(99)
            os.close(here)
            with os.fdopen(there, "rb") as pipe:
                trace = pipe.read()
            code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        print(json.dumps({"code": code, "trace": trace.decode()}), flush=True)


main()
