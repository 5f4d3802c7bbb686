"""Candidates in fewer rows add what they added."""

from __future__ import annotations

import numpy as np
import pytest

from doe.ahead.forecast import Offer
from doe.ahead.information import Information


@pytest.mark.parametrize("sided", [False, True])
def test_condensed_candidates_add_what_they_added(sided: bool, rng: np.random.Generator) -> None:
    """Forty rows of five directions, also where columns depend on the approach."""
    q, p, n = rng.uniform(-1.0, 1.0, (20, 3)), 9, 6
    spread = rng.normal(size=(20, 40, 5))
    right, left = (spread @ rng.normal(size=(20, 5, p)) for _ in range(2))
    offer = Offer(q, right, left, rng.integers(0, 3, p)) if sided else Offer(q, right)
    known = Information.of(rng.normal(size=(30, p)), n)
    rows, few = (own.rows(slice(None), q[0]) for own in (offer, offer.condensed))
    assert rows.shape == (20, 40, p)
    assert few.shape == (20, 5, p)
    np.testing.assert_allclose(known.tried(few), known.tried(rows), rtol=1e-9)


def test_few_rows_stay_as_they_are(rng: np.random.Generator) -> None:
    offer = Offer(rng.normal(size=(4, 3)), rng.normal(size=(4, 9, 7)))
    assert offer.condensed is offer
