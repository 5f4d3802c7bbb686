"""Candidates in fewer rows add what they added."""

from __future__ import annotations

import numpy as np

from doe.ahead.forecast import Offer
from doe.ahead.information import Information


def test_condensed_candidates_add_what_they_added(rng: np.random.Generator) -> None:
    """Forty rows of five directions."""
    p, n = 9, 6
    offer = Offer(np.zeros((20, 3)), rng.normal(size=(20, 40, 5)) @ rng.normal(size=(20, 5, p)))
    known = Information.of(rng.normal(size=(30, p)), n)
    rows, few = offer.rows, offer.condensed
    assert rows.shape == (20, 40, p)
    assert few.shape == (20, 5, p)
    np.testing.assert_allclose(known.tried(few), known.tried(rows), rtol=1e-9)


def test_few_rows_stay_as_they_are(rng: np.random.Generator) -> None:
    offer = Offer(rng.normal(size=(4, 3)), rng.normal(size=(4, 9, 7)))
    assert offer.condensed is offer.rows
