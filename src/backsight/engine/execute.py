"""Choose the engine that runs a recursion.

The compiler takes longer to import than a short recording takes to run: it is imported only if it
is to compile something.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from backsight.description import words
from backsight.engine.recursion import Recursion
from backsight.errors import EngineError, nearest
from backsight.kernels import library
from backsight.types import Array

if TYPE_CHECKING:
    from backsight.engine import native, vm

Engine: TypeAlias = Annotated[Literal["native", "vm"], EngineError]
"""``native``: machine code by LLVM. ``vm``: CasADi's virtual machine. Their results agree."""

SHORT = 1000
"""Samples below which the virtual machine is done before the machine code is compiled."""

Run = Callable[..., tuple[Array, list[Array]]]


def choose_engine(engine: str | None, samples: int) -> str:
    """Name of the engine: the given one, else the one that is likely to finish first.

    Raises
    ------
    EngineError
        If there is no engine of that name.
    """
    if engine is None:
        return "vm" if samples < SHORT else "native"
    if engine not in words(Engine):
        raise EngineError(f"there is no engine '{engine}': {nearest(engine, words(Engine))}")
    return engine


def prepare(recursion: Recursion, engine: str) -> None:
    """Do what an engine does once per recursion, so that it does not count as run time."""
    if engine == "native":
        _module(engine).compiled(recursion)


def run_recursion(
    recursion: Recursion,
    data: Sequence[Array],
    *,
    engine: str,
    progress: Callable[[int], None] = lambda _: None,
) -> list[Array]:
    """Apply the step to every sample and return the outputs, one row per sample each."""
    run: Run = _module(engine).run
    with library.one_thread():
        return run(recursion, data, carry=recursion.carry0, progress=progress)[1]


def run_part(
    recursion: Recursion,
    carry: Array,
    data: Sequence[Array],
    *,
    engine: str,
    block: int | None = None,
    into: Sequence[Array] = (),
) -> tuple[Array, list[Array]]:
    """Apply the step to some samples: the memory after them, and the outputs, a row each.

    With `block`, so many samples are run in one call, that is, without looking up. The native
    engine puts the outputs `into` arrays that are there.
    """
    run: Run = _module(engine).run
    places = {"into": into} if into else {}
    with library.one_thread():
        return run(recursion, data, carry=carry, block=block, **places)


def stepper(recursion: Recursion, engine: str) -> native.Stepper | vm.Stepper:
    """Apply a recursion to samples as they come.

    Raises
    ------
    EngineError
        If there is no engine of that name or it cannot compile the recursion.
    """
    return _module(choose_engine(engine, 1)).Stepper(recursion)


def _module(engine: str) -> ModuleType:
    return importlib.import_module(f"backsight.engine.{engine}")
