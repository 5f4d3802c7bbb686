"""Set-ups of cameras end at the noise, or say why not."""

from __future__ import annotations

import pytest

from studies.research.benchmarks.camera_starts import ARMS, a_set_up, drawn

pytest.importorskip("cv2", exc_type=ImportError)

# Of each kind one that ended wrong when a camera had one start.
QUICK = (0, 76, 80, 163, 197, 438)


@pytest.mark.parametrize("index", QUICK)
def test_a_set_up_ends_right(index: int) -> None:
    assert a_set_up(index, 0)["end"] == "right"


def test_kinds_are_all_drawn() -> None:
    kinds = [drawn(k, 1).kind for k in range(25)]
    assert {kind["arm"] for kind in kinds} == set(ARMS)
    assert len({tuple(kind.values()) for kind in kinds}) > 20
