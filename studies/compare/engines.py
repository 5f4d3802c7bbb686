"""Where trials are computed: here, on processes of this machine, or on a dask cluster."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from calib.errors import InputError

_PATIENCE_S = 10


@contextmanager
def engine(workers: int = 1, scheduler: str | None = None) -> Iterator[Executor | None]:
    """An executor that is shut down at the end; None means: in this process.

    workers : int, processes of this machine; scheduler : str, address of a dask scheduler

    Raises InputError where the scheduler cannot be reached or dask is not installed.
    """
    if scheduler is not None:
        with _cluster(scheduler) as executor:
            yield executor
    elif workers > 1:
        # Fresh processes: a fork would copy this one's threads half-way through their work.
        pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_leave_interrupts)
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    else:
        yield None


def _leave_interrupts() -> None:
    """Ctrl-C ends the study, which then ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler", "", "dask is not installed", "pip install 'posecal[cluster]'"
        ) from None
    try:
        client = Client(address, timeout=_PATIENCE_S)
    except (OSError, ValueError, TypeError) as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            "--scheduler", address, f"no scheduler answers ({said})", "start one, or leave it out"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise InputError(
                "--scheduler", address, "has no workers", "start one: dask worker ADDRESS"
            )
        yield client.get_executor(pure=False)
