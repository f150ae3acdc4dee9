"""One thread at a time builds expressions.

CasADi lets go of Python's lock while it works, and expressions share numbers and symbols inside it:
two threads that build at once have ended the process, once in some thousand times. What was built
may run in as many threads as there are.
"""

import functools
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
Made = TypeVar("Made")

_LOCK = threading.RLock()


def built_alone(function: Callable[Given, Made]) -> Callable[Given, Made]:
    """Let no other thread build while the function does."""

    @functools.wraps(function)
    def alone(*args: Given.args, **kwargs: Given.kwargs) -> Made:
        with _LOCK:
            return function(*args, **kwargs)

    return alone
