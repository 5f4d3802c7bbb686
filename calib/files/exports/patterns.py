"""Boards of a cell as patterns that can be found in images: chessboards, ChArUco, grids of tags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.arrays import Array
from calib.errors import InputError
from calib.files.boards import shape_of
from calib.files.cell import cell_table

_MM = 1e-3


@dataclass(frozen=True, eq=False)
class Pattern:
    """What is printed on a board.

    size : squares or tags across and down; pitch : m, from one to the next
    marker : m, of a marker in a white square, or of a tag; 0 for a plain chessboard
    dictionary : of the markers or tags, "" for a plain chessboard
    names : of the points, in the order of those in its frame, ndarray, shape (n, 3), m
    """

    name: str
    size: tuple[int, int]
    pitch: float
    marker: float
    dictionary: str
    tags: bool
    first_tag: int
    names: tuple[str, ...]
    points: Array


def pattern_of(cell_path: Path, name: str) -> Pattern:
    """The pattern of a board of a cell file. Raises InputError for a board that is none."""
    table = cell_table(cell_path)
    if name not in table.boards:
        known = f"boards are {', '.join(table.boards)}" if table.boards else "it has no [boards]"
        raise InputError("--board", "", f"{name!r} is not in {cell_path}", known)
    board = table.boards[name]
    names, points = shape_of(board)
    if board.tags is not None and board.dictionary is None:
        what = "has tags and no dictionary"
        raise InputError(cell_path, f"boards.{name}", what, "name it, as apriltag_36h11")
    if board.tags is not None and board.tag_mm and board.gap_mm and board.dictionary:
        pitch = (board.tag_mm + board.gap_mm) * _MM
        own = (board.tags, pitch, board.tag_mm * _MM, board.dictionary, True, board.first_tag)
        return Pattern(name, *own, names, points)
    if board.squares is None or board.pitch_mm is None:
        what = "has points_mm alone, which no picture shows"
        remedy = "give squares and pitch_mm, or tags, tag_mm and gap_mm"
        raise InputError(cell_path, f"boards.{name}", what, remedy)
    if board.dictionary is None and sum(board.squares) % 2 == 0:
        what = (
            f"of {board.squares[0]} x {board.squares[1]} squares looks the same turned by 180 deg"
        )
        remedy = "use an even and an odd number, or ChArUco (dictionary, marker_mm)"
        raise InputError(cell_path, f"boards.{name}", what, remedy)
    marker, words = (board.marker_mm or 0.0) * _MM, board.dictionary or ""
    return Pattern(
        name, board.squares, board.pitch_mm * _MM, marker, words, False, 0, names, points
    )
