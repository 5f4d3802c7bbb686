"""A residual holds as many lengths as its instrument reads, and is told in one unit."""

from __future__ import annotations

import pytest

from studies.results.identify import IdentifyResidual

OF = {"pose": "p1", "marker": "m1", "heldout": False, "instrument": "tracker"}


@pytest.mark.parametrize("count", [1, 2, 3])
def test_one_to_three_lengths(count: int) -> None:
    lengths = dict(zip(("x_mm", "y_mm", "z_mm"), (0.1, 0.2, 0.3)[:count], strict=False))
    own = IdentifyResidual(**OF, **lengths, nominal_mm=(1.0, 2.0, 3.0)[:count])
    assert own.metric
    assert own.vector == tuple(lengths.values())
    assert own.before == (1.0, 2.0, 3.0)[:count]
