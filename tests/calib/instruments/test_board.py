"""When a board counts as seen, and how its noise grows."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array
from calib.instruments.board import Board

cv2 = pytest.importorskip("cv2", exc_type=ImportError)


def test_a_board_is_seen_from_its_face_and_whole() -> None:
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(4)]) * 0.02
    board = Board("b", slice(0, 12), points, 0.02, 8.0, 12)
    every = np.ones(12, dtype=bool)

    def ok(turn: float, away: float, seen: Array = every) -> bool:
        R = cv2.Rodrigues(np.array([turn, 0.0, 0.0]))[0]
        viewed = (points - points.mean(axis=0)) @ R.T + [0.0, 0.0, away]
        return bool(board.found(viewed, seen, np.radians(60.0)).all())

    assert ok(0.0, 1.0)
    assert ok(np.radians(58.0), 1.0)
    assert not ok(np.radians(60.0), 1.0), "leaning too far"
    assert not ok(np.pi, 1.0), "its back"
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
