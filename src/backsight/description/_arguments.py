"""The arguments of public functions, checked before anything is read or computed."""

import functools
import inspect
import typing
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from backsight.description._fits import fault
from backsight.errors import BacksightError, TuningError

P = ParamSpec("P")
T = TypeVar("T")


def checked(
    refusal: type[BacksightError] = TuningError, *, only: tuple[str, ...] = ()
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Check the arguments of a function against their annotations when it is called.

    Parameters
    ----------
    refusal : type
        The error that says what is wrong with the arguments, all at once; an annotation that holds
        an error of its own comes before it.
    only : tuple of str
        Arguments to check, where the function says more about the others itself.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(function)

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            # Wrong numbers of arguments are Python's own to tell.
            given = signature.bind(*args, **kwargs).arguments
            hints = _hints(function)
            problems = {
                name: message
                for name, value in given.items()
                if name in hints
                and (not only or name in only)
                and (message := fault(hints[name], value, name))
            }
            if problems:
                kind = _refusal(hints[next(iter(problems))]) or refusal
                raise kind.about(function.__name__, "; ".join(problems.values()))
            return function(*args, **kwargs)

        return call

    return decorate


@functools.cache
def _hints(function: Callable[..., object]) -> dict[str, Any]:
    hints = typing.get_type_hints(function, include_extras=True)
    arguments = inspect.signature(function).parameters.items()
    # Those of *args say what every one of them is.
    return {n: hints[n] for n, a in arguments if n in hints and a.kind is not a.VAR_POSITIONAL}


def _refusal(hint: Any) -> type[BacksightError] | None:
    """The error that an annotation names."""
    options = (hint, *typing.get_args(hint))
    found = [a for a in options if isinstance(a, type) and issubclass(a, BacksightError)]
    inner = [_refusal(o) for o in typing.get_args(hint) if typing.get_origin(o)]
    return next((kind for kind in (*found, *inner) if kind), None)
