"""Camera, board or arm: two days that OpenCV's projection made are judged rightly."""

from __future__ import annotations

import pytest

from studies.research.bench import data_folder
from studies.research.benchmarks.lenses import a_day

pytest.importorskip("cv2", exc_type=ImportError)
pytestmark = pytest.mark.skipif(
    not data_folder("panda_sockets_2").exists(), reason="the shared data are not here"
)


@pytest.mark.parametrize(
    ("case", "causes"),
    [
        ("F", {"principal_point:camera:camera"}),
        ("B", {"joint_compliance:panda_joint4"}),
        pytest.param("N", set(), marks=pytest.mark.long),
        pytest.param("G", {"distortion:camera:camera"}, marks=pytest.mark.long),
    ],
)
def test_the_side_that_errs_is_named(case: str, causes: set[str]) -> None:
    day = a_day(case, 100)
    assert day["right"]
    assert day["aside"] == 0
    assert set(day["causes"]) == causes
