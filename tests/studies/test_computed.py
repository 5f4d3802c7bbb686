"""Jobs by an executor: all of them, few at once, each with its number."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from studies.engines import computed


@pytest.mark.parametrize("ahead", [1, 3, 256])
def test_every_job_once_and_few_ahead(ahead: int) -> None:
    drawn: list[int] = []

    def jobs() -> Iterator[tuple[int, int]]:
        for k in range(20):
            drawn.append(k)
            yield k, 7

    with ThreadPoolExecutor(2) as executor:
        found = {}
        for number, result in computed(divmod, jobs(), executor, ahead):
            found[number] = result
            assert len(drawn) <= len(found) + ahead
    assert found == {k: divmod(k, 7) for k in range(20)}
    assert found == dict(computed(divmod, jobs(), None, ahead))


def test_a_fault_comes_through() -> None:
    with ThreadPoolExecutor(2) as executor, pytest.raises(ZeroDivisionError):
        list(computed(divmod, ((1, k) for k in (2, 1, 0)), executor))
