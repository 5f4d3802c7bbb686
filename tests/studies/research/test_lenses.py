"""Camera, board or arm: two days that OpenCV's projection made are judged rightly."""

from __future__ import annotations

import pytest

from studies.research.benchmarks.lenses import a_day

pytest.importorskip("cv2", exc_type=ImportError)
pytestmark = pytest.mark.usefixtures("data")


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "cause"),
    [
        ("B", "joint_compliance:panda_joint4"),
        ("F", "principal_point:camera:camera"),
        ("G", "distortion:camera:camera"),
    ],
)
def test_the_side_that_errs_is_named(case: str, cause: str) -> None:
    day = a_day(case, 100)
    assert day["right"]
    assert day["aside"] == 0
    assert day["causes"] == [cause]


@pytest.mark.long
def test_a_board_of_another_size_is_told_beside_an_arm_of_another_size() -> None:
    """A free geometry takes it for its own; neither is blamed alone."""
    day = a_day("D", 100)
    assert (day["right"], day["verdict"]) == (True, "ambiguous")
    assert day["causes"] == ["board_scale:board:board"]
    assert day["aside"] == 0


@pytest.mark.long
def test_shares_of_the_sides_add_up() -> None:
    day = a_day("C", 100)
    assert sum(day["sides"].values()) == pytest.approx(1.0, abs=0.02)
    assert day["sides"]["camera"] > day["sides"]["arm"] > 0.02
    assert day["sides"]["board"] == 0.0
