"""One thread of linear algebra: the matrices here are small and many.

Threads gain a tenth on an idle machine and lose a factor of ten on a busy one, where they wait for each
other at every call.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def one_blas_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function with the linear algebra libraries held to one thread."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        import scipy.linalg  # noqa: F401  SciPy brings a library of its own, limited only once loaded
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return run
