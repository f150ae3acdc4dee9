"""Cases in processes of their own, with a limit of time and memory for each."""

import dataclasses
import json
import os
import random
import select
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from backsight.errors import BacksightError, BacksightWarning

CHUNK = 100
"""Cases of a process."""

LONGEST, MOST_LINES = 2000, 20
"""Characters and lines of a message at most."""


@dataclasses.dataclass(frozen=True)
class Area:
    """What is tried.

    Parameters
    ----------
    name : str
    make : callable
        Bytes of a case, from a source of random numbers.
    attempt : callable
        What a user would do with them; None, or one of the package's errors.
    """

    name: str
    make: Callable[[random.Random], bytes]
    attempt: Callable[[bytes], None]


@dataclasses.dataclass(frozen=True)
class Found:
    """What came of a case.

    Parameters
    ----------
    seed : int
    kind : str
        "fine", "refused"; else what nobody should see.
    where : str
    seconds : float
    """

    seed: int
    kind: str
    where: str = ""
    seconds: float = 0.0

    @property
    def is_bad(self) -> bool:
        """Whether nobody should see it."""
        return self.kind not in ("fine", "refused")


def judged(area: Area, case: bytes) -> tuple[str, str]:
    """Kind and place of what a case leads to."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            area.attempt(case)
            kind = "fine"
        except BacksightError as error:
            text, kind = str(error), "refused"
            if len(text) > LONGEST or text.count("\n") >= MOST_LINES:
                return "too long a message", text[:200]
        except BaseException as error:
            return "traceback", _place(error)
    for one in said:
        if not issubclass(one.category, BacksightWarning):
            file = Path(one.filename).name
            return "warning", f"{one.category.__name__} {file}:{one.lineno} {one.message}"[:300]
    return kind, ""


def _place(error: BaseException) -> str:
    """Type of an error, and where in the package it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "/backsight/" in f.filename]
    last, inner = own[-1] if own else frames[-1], frames[-1]
    file = last.filename.rpartition("/backsight/")[2]
    return (
        f"{type(error).__name__} {file}:{last.lineno} {last.name}, "
        f"{Path(inner.filename).name}:{inner.lineno}: {str(error)[:120]}"
    )


def case_of(area: Area, seed: int) -> bytes:
    """The case of a seed."""
    return area.make(random.Random(f"{area.name} {seed}"))


def tried(
    area: Area, *, first: int, count: int, until: float, limit: float = 120.0, memory: int = 6 << 30
) -> Iterator[Found]:
    """Try the cases of many seeds.

    Parameters
    ----------
    area : Area
    first, count : int
        Seeds.
    until : float
        Of `time.monotonic`; no case begins later.
    limit : float
        Seconds of a case.
    memory : int
        Bytes of address space.
    """
    seed = first
    while seed < first + count and time.monotonic() < until:
        for found in _chunk(area, seed, min(seed + CHUNK, first + count), until, limit, memory):
            seed = found.seed + 1
            yield found


def _chunk(
    area: Area, seed: int, stop: int, until: float, limit: float, memory: int
) -> Iterator[Found]:
    there, here = os.pipe()
    child = os.fork()
    if not child:
        os.close(there)
        _work(area, range(seed, stop), here, until, memory)
    os.close(here)
    ended, at, began = True, seed, time.monotonic()
    with os.fdopen(there, "rb", buffering=0) as pipe:
        rest = b""
        while True:
            if not select.select([pipe], [], [], 1.0)[0]:
                if time.monotonic() - began < limit:
                    continue
                os.kill(child, signal.SIGKILL)
                ended = False
                break
            read = pipe.read(1 << 16)
            if not read:
                break
            *lines, rest = (rest + read).split(b"\n")
            for line in lines:
                yield Found(**json.loads(line))
                at, began = at + 1, time.monotonic()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if not ended:
        yield Found(at, "no end", f"{limit:g} s", limit)
    elif code:
        yield Found(at, "crash", f"exit code {code}")


def _work(area: Area, seeds: range, answer: int, until: float, memory: int) -> None:
    import resource

    code = 1
    try:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        for seed in seeds:
            if time.monotonic() > until:
                break
            began = time.perf_counter()
            kind, where = judged(area, case_of(area, seed))
            found = Found(seed, kind, where, round(time.perf_counter() - began, 3))
            os.write(answer, (json.dumps(dataclasses.asdict(found)) + "\n").encode())
        code = 0
    except BaseException:
        traceback.print_exc(file=sys.stderr)
    finally:
        os._exit(code)
