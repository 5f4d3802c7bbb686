"""What screens exchanges must never hide a better one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.doe.problems import criteria, random_blocks, random_information

P = 5


@pytest.mark.parametrize("rows", [1, 2, 5])
@pytest.mark.parametrize("name", list(criteria(np.random.default_rng(0), P)))
def test_screen_lies_above(name: str, rows: int) -> None:
    rng = np.random.default_rng(rows)
    criterion, blocks = criteria(rng, P)[name], random_blocks(rng, 200, P, rows)
    for scale in (1e-6, 1.0, 100.0):
        base = scale * random_information(rng, P)
        values = criterion.value(base + blocks.matrices(np.arange(200)))
        above = criterion.screen(base, blocks.packed, blocks.rank)
        assert (above >= values * (1.0 - 1e-9)).all()
