"""When a board counts as seen: OpenCV finds it in photographs where that is said, and not far below."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.images import pattern_of
from calib.instruments.detection import LEAST_MARKER, LEAST_SQUARE, Board, Detection
from tests.calib.files.test_images import CHARUCO, SQUARES, TAGS, charuco, chessboard, tags
from tests.camera_cells import PINHOLE, camera_cell
from tests.photographs import FOCAL, SIZE, cv2, facing, photograph, pixels, read_images

PRINTED = {  # keys of the board, the print, the side of its smallest figure [m], which is so many px
    "chessboard": (SQUARES, chessboard, 0.030, LEAST_SQUARE),
    "charuco": (CHARUCO, charuco, 0.022, LEAST_MARKER),
    "tags": (TAGS, tags, 0.040, LEAST_MARKER),
}
BLUR, NOISE = 0.7, 3.0  # px, grey levels


def photographs(kind: str, across: float, tilt: float, cell: Path) -> Iterator[tuple[Any, ...]]:
    """Six images of a board whose figure is so many px across, foreshortened; its pattern and place."""
    drawn, side = PRINTED[kind][1:3]
    pattern = pattern_of(cell, "b")
    rng = np.random.default_rng(0)
    for _ in range(6):
        way = rng.uniform(0.0, 2.0 * np.pi)
        leaning = tilt * np.cos(way), tilt * np.sin(way)
        size = pattern.points.max(axis=0) + pattern.points.min(axis=0)
        away = FOCAL * side * np.cos(tilt) / across
        T = facing(rng.uniform(0.0, 2.0 * np.pi), leaning, (size[0], size[1]), away)
        assert inside(pixels(pattern.points, T)).all()
        image = cv2.GaussianBlur(photograph("opencv", drawn(), T), (0, 0), BLUR)
        grey = 40.0 + 0.7 * image + rng.normal(0.0, NOISE, image.shape)
        yield np.clip(grey, 0, 255).astype(np.uint8), pattern, T


def found(kind: str, across: float, tilt: float, folder: Path) -> float:
    """The share of its points that is found where its figure is so many px across, foreshortened."""
    cell = folder / "cell.toml"
    cell.write_text(camera_cell(PRINTED[kind][0], PINHOLE))
    shares = [
        len(points_in(image, pattern, folder)) / len(pattern.points)
        for image, pattern, _ in photographs(kind, across, tilt, cell)
    ]
    return float(np.mean(shares))


def inside(uv: Array) -> Any:
    return ((uv > 10.0) & (uv < np.array(SIZE) - 10.0)).all(axis=1)


def points_in(image: Any, pattern: Any, folder: Path) -> list[Any]:
    cv2.imwrite(str(folder / "i.png"), image)
    try:
        return list(read_images([folder / "i.png"], [pattern])[0].points)
    except InputError:
        return []


@pytest.mark.sampled
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


@pytest.mark.parametrize("kind", ["chessboard", "charuco"])
def test_small_figures_are_found_as_much_worse_as_the_noise_says(kind: str, tmp_path: Path) -> None:
    """At the least size, and leaning, against more than twice that, face on."""
    least = PRINTED[kind][3]
    large = spread(kind, 2.25 * least, 0.0, tmp_path)
    expected = np.hypot(1.0, 2.0 / 2.25)
    for across, tilt in ((least, 0.0), (1.5 * least, np.radians(50.0))):
        ratio = spread(kind, across, tilt, tmp_path) / large
        assert ratio == pytest.approx(np.hypot(1.0, 2.0 * least / across) / expected, rel=0.25)


def spread(kind: str, across: float, tilt: float, folder: Path) -> float:
    """Standard deviation of a coordinate, px, of the points that are found."""
    cell = folder / "cell.toml"
    cell.write_text(camera_cell(PRINTED[kind][0], PINHOLE))
    off: list[Array] = []
    for image, pattern, T in photographs(kind, across, tilt, cell):
        at = dict(zip(pattern.names, pixels(pattern.points, T), strict=True))
        points = points_in(image, pattern, folder)
        beyond = np.array([p.values for p in points], float) - [
            at[p.point.removeprefix("b:")] for p in points
        ]
        off.append(beyond - np.median(beyond, axis=0))
    return float(1.4826 * np.median(np.abs(np.concatenate(off))))


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
