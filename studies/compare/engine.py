"""Where much of one kind is computed: here, on processes of this machine, or on a dask cluster."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from calib.errors import InputError

_PATIENCE_S = 6


@contextmanager
def engine(workers: int = 1, scheduler: str | None = None) -> Iterator[Executor | None]:
    """An executor, shut down at the end; None means: in this process.

    Raises InputError where the scheduler cannot be reached, dask is not installed or a worker died.
    """
    if scheduler is not None:
        try:
            from distributed import Client

            client = Client(scheduler, timeout=_PATIENCE_S)
        except ImportError:
            remedy = "pip install 'posecal[cluster]'"
            raise InputError("--scheduler", "", "dask is not installed", remedy) from None
        except (OSError, ValueError):
            remedy = "start one, or leave it out"
            raise InputError("--scheduler", scheduler, "no scheduler answers", remedy) from None
        with client:
            yield client.get_executor(pure=False)
    elif workers > 1:
        ignore = (signal.SIGINT, signal.SIG_IGN)
        try:
            with ProcessPoolExecutor(workers, get_context("spawn"), signal.signal, ignore) as pool:
                yield pool
        except BrokenProcessPool:
            what = "a worker died, perhaps out of memory"
            raise InputError("--workers", str(workers), what, "take fewer") from None
    else:
        yield None
