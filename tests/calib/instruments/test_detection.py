"""When a board counts as seen: OpenCV finds it in photographs where that is said, and not far below."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.instruments.detection import LEAST_MARKER, LEAST_SQUARE, Board, Detection
from tests.photographs import (
    FOCAL,
    SIZE,
    charuco,
    chessboard,
    cv2,
    facing,
    found_by_opencv,
    photograph,
    pixels,
    points_of,
    tags,
)

PRINTED = {  # the print, the side of its smallest figure [m], which is so many px
    "chessboard": (chessboard, 0.030, LEAST_SQUARE),
    "charuco": (charuco, 0.022, LEAST_MARKER),
    "tags": (tags, 0.040, LEAST_MARKER),
}
BLUR, NOISE = 0.7, 3.0  # px, grey levels


def photographs(kind: str, across: float, tilt: float) -> Iterator[Any]:
    """Six images of a board whose figure is so many px across, foreshortened."""
    drawn, side = PRINTED[kind][:2]
    points = points_of(kind)
    rng = np.random.default_rng(0)
    for _ in range(6):
        way = rng.uniform(0.0, 2.0 * np.pi)
        leaning = tilt * np.cos(way), tilt * np.sin(way)
        size = points.max(axis=0) + points.min(axis=0)
        away = FOCAL * side * np.cos(tilt) / across
        T = facing(rng.uniform(0.0, 2.0 * np.pi), leaning, (size[0], size[1]), away)
        assert inside(pixels(points, T)).all()
        image = cv2.GaussianBlur(photograph("opencv", drawn(), T), (0, 0), BLUR)
        grey = 40.0 + 0.7 * image + rng.normal(0.0, NOISE, image.shape)
        yield np.clip(grey, 0, 255).astype(np.uint8)


def found(kind: str, across: float, tilt: float) -> float:
    """The share of its points that is found where its figure is so many px across, foreshortened."""
    shares = [found_by_opencv(kind, image) for image in photographs(kind, across, tilt)]
    return float(np.mean(shares)) / len(points_of(kind))


def inside(uv: Array) -> Any:
    return ((uv > 10.0) & (uv < np.array(SIZE) - 10.0)).all(axis=1)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", PRINTED)
@pytest.mark.parametrize("tilt_deg", [0.0, 45.0, 59.0])
def test_the_limits_are_those_of_opencv(kind: str, tilt_deg: float) -> None:
    least = PRINTED[kind][2]
    assert found(kind, least, np.radians(tilt_deg)) > 0.8
    assert found(kind, 0.4 * least, np.radians(tilt_deg)) < 0.3


def test_a_board_is_seen_from_its_face_whole_and_large_enough() -> None:
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(4)]) * 0.02
    board = Board("b", slice(0, 12), points, 0.02, 8.0, 12)
    limits, every = Detection(), np.ones(12, dtype=bool)

    def ok(turn: float, away: float, seen: Array = every) -> bool:
        R = cv2.Rodrigues(np.array([turn, 0.0, 0.0]))[0]
        viewed = (points - points.mean(axis=0)) @ R.T + [0.0, 0.0, away]
        return bool(board.found(viewed, seen, 1000.0, limits).all())

    assert ok(0.0, 1.0)
    assert ok(np.radians(58.0), 1.0)
    assert not ok(np.radians(60.0), 1.0), "leaning too far"
    assert not ok(np.pi, 1.0), "its back"
    assert ok(0.0, 2.49), "1000 px x 20 mm / 8 px"
    assert not ok(0.0, 2.51)
    assert not ok(0.0, 1.0, np.arange(12) > 0), "a chessboard is found whole"


def test_five_lines_of_sight_stand_for_a_board() -> None:
    points = np.array([[x, y, 0.0] for y in range(8) for x in range(11)]) * 0.02
    parts = list(Board("b", slice(0, 88), points).parts())
    assert len(parts) == 5
    assert sorted(k for few, _ in parts for k in few) == list(range(88))
    assert all(one in few for few, one in parts)
    assert {0, 10, 77, 87} <= {one for _, one in parts}, "the corners"


def test_noise_grows_as_figures_look_smaller() -> None:
    points = np.array([[x, y, 0.0] for y in range(8) for x in range(11)]) * 0.02
    board = Board("b", slice(0, 88), points, 0.02, 10.0, 88)

    def image(away: float, tilt: float) -> Array:
        R = cv2.Rodrigues(np.array([tilt, 0.0, 0.0]))[0]
        viewed = (points - points.mean(axis=0)) @ R.T + [0.0, 0.0, away]
        return 900.0 * viewed[:, :2] / viewed[:, 2:] + 640.0

    faced = image(0.9, 0.0)  # squares of 20 px
    assert board.noise(faced) == pytest.approx(np.sqrt(2.0))
    assert board.noise(image(1.8, 0.0)) == pytest.approx(np.sqrt(5.0))
    assert board.noise(image(0.9, np.radians(60.0))) == pytest.approx(np.sqrt(5.0), rel=0.02)
    part = np.arange(88)[:, None] % 3 > 0
    assert board.noise(faced * part) == pytest.approx(np.sqrt(2.0)), "what is hidden is zero"
    assert board.noise(faced * 0.0) == 1.0
    line = np.arange(88)[:, None] < 11
    assert board.noise(faced * line) == 1.0, "points on a line show no side"
