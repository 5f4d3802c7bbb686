"""What ranks candidates of few poses, and the plans that are found, against ways that share nothing."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.exchange import exchange
from tests.doe.problems import criteria, grouped, random_blocks


@pytest.mark.parametrize("name", ["D", "A", "task", "E"])
@pytest.mark.parametrize("poses", [3, 8])
def test_an_exchange_ends_where_no_pose_is_better_elsewhere(name: str, poses: int) -> None:
    """Every candidate tried in place of every pose; of three poses, two alone leave the model open."""
    rng = np.random.default_rng(poses)
    blocks, allowed = random_blocks(rng, 200, 6, 2), grouped(200, 1, poses)
    criterion = criteria(rng, 6)[name]
    plan, value = exchange(criterion, blocks, allowed, np.arange(poses))
    for slot in range(poses):
        rest = np.delete(plan, slot)
        for other in np.setdiff1d(np.arange(200), plan):
            tried = float(criterion.value(blocks.total(np.append(rest, other))))
            assert tried <= value * (1.0 + 1e-6)
