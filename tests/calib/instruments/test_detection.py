"""When a board counts as seen: OpenCV finds it in photographs where that is said, and not far below."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.files.exports.images import pattern_of, read_images
from calib.instruments.detection import LEAST_MARKER, LEAST_SQUARE, Board, Detection
from tests.calib.files.test_images import CHARUCO, SQUARES, TAGS, charuco, chessboard, tags
from tests.camera_cells import PINHOLE, camera_cell
from tests.photographs import FOCAL, SIZE, cv2, facing, photograph, pixels

PRINTED = {  # keys of the board, the print, the side of its smallest figure [m], which is so many px
    "chessboard": (SQUARES, chessboard, 0.030, LEAST_SQUARE),
    "charuco": (CHARUCO, charuco, 0.022, LEAST_MARKER),
    "tags": (TAGS, tags, 0.040, LEAST_MARKER),
}
BLUR, NOISE = 0.7, 3.0  # px, grey levels


def found(kind: str, across: float, tilt: float, folder: Path) -> float:
    """The share of its points that is found where its figure is so many px across, foreshortened."""
    keys, drawn, side, _ = PRINTED[kind]
    (folder / "cell.toml").write_text(camera_cell(keys, PINHOLE))
    pattern = pattern_of(folder / "cell.toml", "b")
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(6):
        way = rng.uniform(0.0, 2.0 * np.pi)
        leaning = tilt * np.cos(way), tilt * np.sin(way)
        size = pattern.points.max(axis=0) + pattern.points.min(axis=0)
        away = FOCAL * side * np.cos(tilt) / across
        T = facing(rng.uniform(0.0, 2.0 * np.pi), leaning, (size[0], size[1]), away)
        assert inside(pixels(pattern.points, T)).all()
        image = cv2.GaussianBlur(photograph("opencv", drawn(), T), (0, 0), BLUR)
        grey = 40.0 + 0.7 * image + rng.normal(0.0, NOISE, image.shape)
        cv2.imwrite(str(folder / "i.png"), np.clip(grey, 0, 255).astype(np.uint8))
        shares.append(count(folder / "i.png", pattern) / len(pattern.points))
    return float(np.mean(shares))


def inside(uv: Array) -> Any:
    return ((uv > 10.0) & (uv < np.array(SIZE) - 10.0)).all(axis=1)


def count(image: Path, pattern: Any) -> int:
    from calib.errors import InputError

    try:
        return len(read_images([image], [pattern])[0].points)
    except InputError:
        return 0


@pytest.mark.parametrize("kind", PRINTED)
@pytest.mark.parametrize("tilt_deg", [0.0, 45.0, 59.0])
def test_the_limits_are_those_of_opencv(kind: str, tilt_deg: float, tmp_path: Path) -> None:
    least = PRINTED[kind][3]
    assert found(kind, least, np.radians(tilt_deg), tmp_path) > 0.8
    assert found(kind, 0.4 * least, np.radians(tilt_deg), tmp_path) < 0.3


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
