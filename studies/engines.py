"""Where much of one kind is computed: here, on processes of this machine, or on a dask cluster."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from itertools import islice
from multiprocessing import get_context, parent_process
from queue import SimpleQueue
from typing import Any, TypeVar

import loky
from loky.process_executor import TerminatedWorkerError

from calib.errors import InputError

T = TypeVar("T")

_PATIENCE_S = 6


@contextmanager
def engine(workers: int = 1, scheduler: str | None = None) -> Iterator[Executor | None]:
    """An executor that is shut down at the end; None means: in this process.

    workers : int, processes of this machine; scheduler : str, address of a dask scheduler

    Raises InputError where the scheduler cannot be reached or dask is not installed, and at the end
    where a worker died or the cluster was lost.
    """
    if scheduler is not None:
        with _cluster(scheduler) as executor:
            yield executor
    elif workers > 1:
        # A context whose processes know their parent, and start no tracker that lets Ctrl-C through.
        pool = loky.ProcessPoolExecutor(
            workers, context=get_context("spawn"), initializer=_stay_with_parent
        )
        try:
            yield pool
        except TerminatedWorkerError:
            raise InputError(
                "--workers", str(workers), "a worker died, perhaps out of memory", "take fewer"
            ) from None
        finally:
            pool.shutdown(kill_workers=True)  # what still runs was given up
    else:
        yield None


def computed(
    function: Callable[..., T],
    jobs: Iterable[tuple[Any, ...]],
    executor: Executor | None,
    ahead: int = 256,
) -> Generator[tuple[int, T]]:
    """What a function makes of jobs, as it comes, each with the number of its job.

    jobs : arguments of each call; executor : where they are computed, here without one
    ahead : int, most jobs that are given out at once

    An interruption is raised as KeyboardInterrupt between two results; close it then. What was given
    out ends with the engine.
    """
    if executor is None:
        for index, job in enumerate(jobs):
            yield index, function(*job)
        return
    done: SimpleQueue[Future[T] | None] = SimpleQueue()  # None is an interruption
    numbers: dict[Future[T], int] = {}
    waiting = enumerate(jobs)

    def give(most: int) -> None:
        with _interrupts_held():  # processes are started here and inherit it
            for index, job in islice(waiting, most):
                future = executor.submit(function, *job)
                numbers[future] = index
                future.add_done_callback(done.put)

    with _interrupts_in(done):
        give(ahead)
        while numbers:
            ready = done.get()
            if ready is None:
                raise KeyboardInterrupt
            index = numbers.pop(ready)
            give(1)
            yield index, ready.result()


@contextmanager
def _interrupts_in(queue: SimpleQueue[Any]) -> Iterator[None]:
    """Ctrl-C puts None into a queue, where it is read when that suits, instead of being raised at once.

    Raised just as the lock of a future is taken it would leave it taken, and the pool could not end.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield  # elsewhere it is not raised
        return
    signal.signal(signal.SIGINT, lambda *_: queue.put(None))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C for later; processes started meanwhile never see it, not even while they import."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _stay_with_parent() -> None:
    """Leave Ctrl-C to the study, and end with it even where it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("PYTHONFAULTHANDLER", "")  # how it died is said in one line, not by loky
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise InputError(
            "--scheduler", "", "dask is not installed", "pip install 'posecal[cluster]'"
        ) from None
    _knock(address)
    with Client(address, timeout=_PATIENCE_S) as client:
        if not client.scheduler_info()["workers"]:
            raise InputError(
                "--scheduler", address, "has no workers", "start one: dask worker ADDRESS"
            )
        try:
            yield client.get_executor(pure=False)
        except KilledWorker:
            raise InputError(
                "--scheduler", address, "its workers died, perhaps out of memory", "see their logs"
            ) from None
        except (CancelledError, OSError):
            raise InputError(
                "--scheduler", address, "was lost", "see its log, then start anew"
            ) from None


def _knock(address: str) -> None:
    """See that a scheduler answers, in a loop of our own: dask waits for ever for a silent port."""
    from distributed import Client

    async def connect() -> None:
        client = Client(address, timeout=_PATIENCE_S, asynchronous=True)
        try:
            await client
        finally:
            await client.close()

    try:
        asyncio.run(asyncio.wait_for(connect(), _PATIENCE_S + 0.5))
    except Exception as error:  # whatever listens there may answer anything
        said = str(error).splitlines()[0] if str(error) else f"silent for {_PATIENCE_S} s"
        raise InputError(
            "--scheduler", address, f"no scheduler answers ({said})", "start one, or leave it out"
        ) from None
