"""Jobs by an executor: all of them, few at once, each with its number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from typing import Any

import pytest

from studies.engines import computed


class Counting(ThreadPoolExecutor):
    """Counts what it was given and keeps it."""

    def __init__(self) -> None:
        super().__init__(2)
        self.given: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.given.append(super().submit(fn, *args, **kwargs))
        return self.given[-1]


@pytest.mark.parametrize("ahead", [1, 3, None])
def test_every_job_once_and_few_ahead(ahead: int | None) -> None:
    drawn: list[int] = []

    def jobs() -> Iterator[tuple[int, int]]:
        for k in range(20):
            drawn.append(k)
            yield k, 7

    with Counting() as executor:
        found = {}
        for number, result in computed(divmod, jobs(), executor, ahead):
            found[number] = result
            assert len(drawn) <= len(found) + (ahead or 20)
    assert found == {k: divmod(k, 7) for k in range(20)}
    assert found == dict(computed(divmod, jobs(), None, ahead))


def test_what_is_not_begun_is_taken_back() -> None:
    import threading

    begun, go_on = threading.Event(), threading.Event()

    def wait(k: int) -> int:
        if k:
            begun.set()
            go_on.wait(10.0)
        return k

    with Counting() as executor:
        with closing(computed(wait, ((k,) for k in range(10)), executor)) as coming:
            assert next(coming) == (0, 0)
            begun.wait(10.0)
        go_on.set()
    assert sum(future.cancelled() for future in executor.given) >= 7


def test_a_fault_comes_through() -> None:
    with Counting() as executor, pytest.raises(ZeroDivisionError):
        list(computed(divmod, ((1, k) for k in (2, 1, 0)), executor))
