"""Boards found in images: within a tenth of a pixel of where a pinhole puts their points.

Images are rendered by MuJoCo where the machine has OpenGL, and by OpenCV's homography of the print.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.images import pattern_of
from tests.camera_cells import PINHOLE, camera_cell
from tests.photographs import DOTS, cv2, facing, photograph, pixels, read_images

SIDE = int(0.03 * DOTS)  # of a square


def chessboard() -> Any:
    """Nine squares across and six down, the first one dark."""
    i, j = np.indices((6 * SIDE, 9 * SIDE)) // SIDE
    return np.where((i + j) % 2 == 0, 0, 255).astype(np.uint8)


def charuco(older: bool = False) -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((9, 6), 0.03, 0.022, words)
    board.setLegacyPattern(older)
    return board.generateImage((9 * SIDE, 6 * SIDE), marginSize=0)


def tags(first: int = 0) -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    numbers = np.arange(first, first + 20)
    board = cv2.aruco.GridBoard((5, 4), 0.04, 0.012, words, numbers)
    return board.generateImage((int(0.248 * DOTS), int(0.196 * DOTS)), marginSize=0)


SQUARES = "squares = [9, 6]\npitch_mm = 30"
CHARUCO = f'{SQUARES}\nmarker_mm = 22\ndictionary = "5x5_100"'
TAGS = 'tags = [5, 4]\ntag_mm = 40\ngap_mm = 12\ndictionary = "DICT_APRILTAG_36h11"'
PRINTS: dict[str, tuple[str, Callable[[], Any], int]] = {
    "chessboard": (SQUARES, chessboard, 40),
    "charuco": (CHARUCO, charuco, 40),
    "older charuco": (CHARUCO, lambda: charuco(older=True), 40),
    "tags": (f"{TAGS}\nfirst_tag = 7", lambda: tags(7), 80),
}
VIEWS = [(0.15, (0.5, -0.3)), (3.0, (-0.45, 0.35))]


def cell_of(folder: Path, board: str) -> Path:
    (folder / "cell.toml").write_text(camera_cell(board, PINHOLE))
    return folder / "cell.toml"


def corners_of_the_print(count: int) -> dict[str, Array]:
    """Where the print has its points, m, by the numbers that people give them."""
    if count == 40:
        return {
            str(8 * y + x): np.array([x + 1, y + 1, 0]) * 0.03 for y in range(5) for x in range(8)
        }
    clock = ((0, 0), (1, 0), (1, 1), (0, 1))
    return {
        f"{7 + 5 * y + x}_{c}": np.array([x * 0.052 + dx * 0.04, y * 0.052 + dy * 0.04, 0.0])
        for y in range(4) for x in range(5) for c, (dx, dy) in enumerate(clock)
    }  # fmt: skip


@pytest.mark.parametrize("by", ["mujoco", "homography"])
@pytest.mark.parametrize(("board", "drawn", "count"), PRINTS.values(), ids=PRINTS)
def test_corners_are_where_a_pinhole_puts_them(
    tmp_path: Path, board: str, drawn: Callable[[], Any], count: int, by: str
) -> None:
    """Half a turn of a chessboard shows, too."""
    pattern, truth = pattern_of(cell_of(tmp_path, board), "b"), corners_of_the_print(count)
    assert set(pattern.names) == set(truth)
    for own, point in zip(pattern.names, pattern.points, strict=True):
        np.testing.assert_allclose(point, truth[own], atol=1e-12)
    for k, (turn, tilt) in enumerate(VIEWS[:1] if by == "mujoco" else VIEWS):
        T = facing(turn, tilt, (0.25, 0.18), 0.45)
        cv2.imwrite(str(tmp_path / f"v{k}.png"), photograph(by, drawn(), T))
        found, blank = read_images([tmp_path / f"v{k}.png"], [pattern])
        assert not blank
        assert {p.group for p in found.points} == {f"v{k}"}
        assert len(found.points) == count
        named = [p.point.removeprefix("b:") for p in found.points]
        at = np.array([[float(v) for v in p.values] for p in found.points])
        off = at - pixels(np.array([truth[n] for n in named]), T)
        assert np.abs(off).max() < 0.1
        assert np.abs(off.mean(axis=0)).max() < 0.02


def test_noise_and_a_board_half_hidden(tmp_path: Path) -> None:
    T = facing(0.3, (0.3, 0.2), (0.25, 0.18), 0.45)
    image = photograph("homography", charuco(), T).astype(float)
    image += np.random.default_rng(2).normal(scale=4.0, size=image.shape)
    image[:, 500:] = 128.0
    cv2.imwrite(str(tmp_path / "p1.png"), np.clip(image, 0, 255).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "p2.png"), np.full((480, 640), 200, np.uint8))
    pattern, truth = pattern_of(cell_of(tmp_path, CHARUCO), "b"), corners_of_the_print(40)
    found, blank = read_images([tmp_path / "p1.png", tmp_path / "p2.png"], [pattern], {"p2.png"})
    assert 8 < len(found.points) < 30
    at = np.array([[float(v) for v in p.values] for p in found.points])
    real = np.array([truth[p.point.removeprefix("b:")] for p in found.points])
    assert np.sqrt(((at - pixels(real, T)) ** 2).mean()) < 0.1
    assert blank == ("p2.png",)


@pytest.mark.parametrize(
    ("board", "said"),
    [
        ("points_mm = { a = [0, 0, 0] }", "has points_mm alone, which no picture shows"),
        ("squares = [9, 7]\npitch_mm = 30", "looks the same turned by 180 deg"),
        ("tags = [5, 4]\ntag_mm = 40\ngap_mm = 12", "has tags and no dictionary"),
    ],
)
def test_boards_that_cannot_be_looked_for(tmp_path: Path, board: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        pattern_of(cell_of(tmp_path, board), "b")
    with pytest.raises(InputError, match=r"--board: 'c' is not in .*; boards are b"):
        pattern_of(cell_of(tmp_path, SQUARES), "c")


def test_what_is_no_picture_of_the_board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "p.png"
    path.write_bytes(b"\x89PNG no more")
    pattern = pattern_of(cell_of(tmp_path, CHARUCO), "b")
    with pytest.raises(InputError, match="is no image that OpenCV reads"):
        read_images([path], [pattern])
    cv2.imwrite(
        str(path), photograph("homography", chessboard(), facing(0, (0, 0), (0.2, 0.2), 0.5))
    )
    with pytest.raises(InputError, match="shows no board b; compare squares, tags and dictionary"):
        read_images([path], [pattern])
    other = pattern_of(cell_of(tmp_path, CHARUCO.replace("5x5_100", "5x5_9")), "b")
    with pytest.raises(InputError, match="OpenCV has no dictionary '5x5_9'"):
        read_images([path], [other])
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(
        InputError, match=r"--board: needs OpenCV, .* pip install 'posecal.images.'"
    ):
        read_images([path], [pattern])
