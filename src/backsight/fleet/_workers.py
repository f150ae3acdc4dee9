"""Who does the work: this process, workers on this computer, or a cluster that is there."""

import abc
import asyncio
import collections
import concurrent.futures
import contextlib
import importlib.metadata
import logging
from collections.abc import Callable, Iterator
from typing import Any

from backsight.engine.parallel import cores
from backsight.errors import WorkerError
from backsight.fleet.items import Work, done, version_here
from backsight.fleet.rows import Landed

Answer = tuple[list[Landed], float]
"""What `done` returns."""

CONNECT = "15s"
"""For how long an answer of a scheduler is waited for."""

DEATHS = 1
"""Workers that a piece of work may take along before it is cut into single recordings."""


class Workers(abc.ABC):
    """They take work and hand it back done, in any order."""

    @property
    @abc.abstractmethod
    def slots(self) -> int:
        """Number of pieces that are worked on at once."""

    @abc.abstractmethod
    def submit(self, work: Work) -> None:
        """Hand out a piece of work."""

    @property
    @abc.abstractmethod
    def running(self) -> int:
        """Number of pieces that are handed out."""

    @abc.abstractmethod
    def finished(self) -> Iterator[tuple[Work, Answer | str]]:
        """Wait until a piece or more is done; of one that took its workers along, the reason.

        Raises
        ------
        WorkerError
            If the workers or their scheduler are gone, or a worker does not fit.
        """


class ThisProcess(Workers):
    """Does the work itself, when it is asked whether it is done."""

    def __init__(self) -> None:
        self._waiting: collections.deque[Work] = collections.deque()

    @property
    def slots(self) -> int:
        """See `Workers.slots`."""
        return 1

    @property
    def running(self) -> int:
        """See `Workers.running`."""
        return len(self._waiting)

    def submit(self, work: Work) -> None:
        """See `Workers.submit`."""
        self._waiting.append(work)

    def finished(self) -> Iterator[tuple[Work, Answer | str]]:
        """See `Workers.finished`."""
        work = self._waiting.popleft()
        yield work, done(work)


class DaskWorkers(Workers):
    """Workers of a scheduler of dask.distributed."""

    def __init__(self, client: Any) -> None:
        import distributed

        self._client = client
        self._works: dict[str, Work] = {}
        # Not `wait`, which looks at every future that runs.
        self._ended: Any = distributed.as_completed(
            loop=client.loop, with_results=True, raise_errors=False
        )

    @property
    def slots(self) -> int:
        """See `Workers.slots`."""
        with _reaching():
            return max(sum(self._client.nthreads().values()), 1)

    @property
    def running(self) -> int:
        """See `Workers.running`."""
        return len(self._works)

    def submit(self, work: Work) -> None:
        """See `Workers.submit`."""
        with _reaching():
            future = self._client.submit(done, work, pure=False)
            self._works[future.key] = work
            self._ended.add(future)

    def finished(self) -> Iterator[tuple[Work, Answer | str]]:
        """See `Workers.finished`."""
        with _reaching():
            batch = self._ended.next_batch()
        for future, result in batch:
            yield self._works.pop(future.key), _answer(future.status, result)


@contextlib.contextmanager
def _reaching() -> Iterator[None]:
    """Say what it means if the scheduler does not answer any more."""
    try:
        yield
    except (OSError, concurrent.futures.CancelledError, asyncio.CancelledError):
        raise WorkerError(GONE) from None


def _answer(status: str, result: Any) -> Answer | str:
    """What a future brought: its result, or kind, error and traceback."""
    import distributed

    if status == "finished":
        return result
    if status != "error":
        raise WorkerError(GONE)
    _, error, _ = result
    match error:
        case distributed.KilledWorker():
            return "the worker died of it, which happens if memory runs out"
        case ModuleNotFoundError():
            raise WorkerError(f"a worker lacks a package ({error}); install backsight[fleet] there")
    raise error


GONE = (
    "the connection to the scheduler is lost; what is finished is kept: start again with the same "
    "folder to go on"
)


@contextlib.contextmanager
def workers_of(
    number: int | None, scheduler: str | None, tell: Callable[[str], None]
) -> Iterator[Workers]:
    """Start workers, or connect to those that are there.

    Parameters
    ----------
    number : int, optional
        Workers on this computer; one for each core by default, none: this process itself.
    scheduler : str, optional
        Address of a scheduler, ``tcp://host:port``.
    tell : callable
        Told what is waited for.

    Raises
    ------
    WorkerError
        If dask.distributed is not installed, the scheduler does not answer, or a worker has
        another version of the package.
    """
    if number == 0 and scheduler is None:
        yield ThisProcess()
        return
    try:
        import dask.config
        import distributed
        from distributed.comm.addressing import get_address_host
    except ImportError as error:
        raise WorkerError(
            f"fleets need dask.distributed ({error}); pip install 'backsight[fleet]', or work in "
            "this process alone: --workers 0"
        ) from None
    # What happens to workers is told by us, in words that say what to do.
    settings = {
        "logging.distributed": "critical",
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.comm.timeouts.connect": CONNECT,
        "distributed.admin.large-graph-warning-threshold": "100MB",
    }
    for name in [n for n in logging.root.manager.loggerDict if n.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        if scheduler is None:
            local: Any = distributed.LocalCluster
            scheduler = stack.enter_context(
                local(
                    n_workers=number or cores(),
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",  # a port that is free, for this computer
                    silence_logs=logging.CRITICAL,
                )
            ).scheduler_address
        try:
            # First, since a client of an address that is none takes half a minute to go.
            get_address_host(str(scheduler))
            client = stack.enter_context(distributed.Client(scheduler, set_as_default=False))
        except (OSError, ValueError, TypeError) as error:
            raise WorkerError(f"the scheduler '{scheduler}' does not answer: {error}") from None
        with _reaching():
            if not client.nthreads():
                tell(f"the scheduler {scheduler} has no workers yet; waiting for the first")
            client.wait_for_workers(1)
            _check_versions(client)
        yield DaskWorkers(client)


def _check_versions(client: Any) -> None:
    """Ask workers with nothing but Python which version they have."""
    here = version_here()
    found = client.run(importlib.metadata.version, "backsight", on_error="return")
    for address, version in found.items():
        if version != here:
            has = f"has version {version}" if isinstance(version, str) else "has no package"
            raise WorkerError(
                f"the worker {address} {has} of Backsight, this is {here}; install the same one"
            )
