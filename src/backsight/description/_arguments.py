"""The arguments of public functions, checked before anything is read or computed."""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from backsight.description._fits import fault, signature_hints
from backsight.errors import BacksightError, TuningError

P = ParamSpec("P")
T = TypeVar("T")


def checked(
    refusal: type[BacksightError] = TuningError, *, only: str = ""
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Check the arguments of a function against their annotations when it is called.

    Parameters
    ----------
    refusal : type
        The error that says what is wrong with the arguments, all at once.
    only : str
        Names of the arguments to check, with spaces between; all that have an annotation if empty.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            # Wrong numbers of arguments are Python's own to tell.
            given = inspect.signature(function).bind(*args, **kwargs).arguments
            hints = _hints(function, only)
            problems = [
                message
                for name, value in given.items()
                if name in hints and (message := fault(hints[name], value, name))
            ]
            if problems:
                raise refusal.about(function.__name__, "; ".join(problems))
            return function(*args, **kwargs)

        return call

    return decorate


@functools.cache
def _hints(function: Callable[..., object], only: str) -> dict[str, Any]:
    hints = signature_hints(function)
    return {n: h for n, h in hints.items() if not only or n in only.split()}
