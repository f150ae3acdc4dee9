"""The one place for work on all cores.

Threads for machine code, which runs without Python's lock; processes for what is mostly Python;
`backsight.fleet` for what shall survive the end of the process or go to other computers.
"""

import concurrent.futures
import contextlib
import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

LOOK_SECONDS = 0.1
"""How often the waiting thread looks and can be interrupted."""

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables by which libraries of linear algebra learn how many threads to start."""


def cores() -> int:
    """Number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(
    task: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    threads: int | None = None,
    look: Callable[[], None] = lambda: None,
    stop: Callable[[], None] = lambda: None,
) -> list[Result]:
    """Do all jobs, one thread per core: machine code runs at the same time.

    Parameters
    ----------
    task : callable
    jobs : sequence
    threads : int, optional
    look : callable
        Called every now and then by the thread that waits.
    stop : callable
        Called after an error or an interrupt, for jobs that can be told to end early.

    Returns
    -------
    list
        The results, in the order of the jobs.
    """
    with concurrent.futures.ThreadPoolExecutor(threads or cores()) as pool:
        futures = [pool.submit(task, job) for job in jobs]
        waiting = set(futures)
        try:
            while waiting:
                finished, waiting = concurrent.futures.wait(waiting, timeout=LOOK_SECONDS)
                for future in finished:
                    future.result()  # an error ends the rest
                look()
        except BaseException:
            stop()
            pool.shutdown(cancel_futures=True)
            raise
    return [future.result() for future in futures]


def in_processes(
    task: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> list[Result]:
    """Do all jobs in processes of their own, which start anew and share nothing with this one.

    They end with this one, also when it is killed. Task and jobs are pickled. A script that comes
    here needs ``if __name__ == "__main__":``. One worker is this process itself: no other is
    started.

    Parameters
    ----------
    task : callable
    jobs : sequence
    workers : int, optional
        One per core by default.
    progress : callable
        Told the number of jobs done.

    Returns
    -------
    list
        The results, in the order of the jobs.
    """
    crew = min(workers or cores(), len(jobs))
    results: list[Result] = []
    if crew <= 1:
        for job in jobs:
            results.append(task(job))
            progress(len(results))
        return results
    fresh = multiprocessing.get_context("spawn")
    pool = concurrent.futures.ProcessPoolExecutor(crew, fresh, _end_with_the_parent)
    with _one_thread_each(), pool:
        try:
            for result in pool.map(task, jobs):
                results.append(result)
                progress(len(results))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return results


def _end_with_the_parent() -> None:
    """End this process when the one that started it has ended: a pool would wait on."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name="end-with-parent", daemon=True).start()


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """New processes start with one thread for linear algebra: they share the cores already."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
