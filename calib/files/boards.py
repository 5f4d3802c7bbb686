"""The points of a board: inner corners of squares, corners of tags, or those that are given."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.files.schema import BoardTable

_MM = 1e-3


def shape_of(board: BoardTable) -> tuple[tuple[str, ...], Array]:
    """Names and points (n, 3), m, of a board, x to the right and y down as one looks at it.

    Of squares the inner corners, row by row; of tags the corners of each, from its upper left one in
    the direction of the clock, ``3_0`` the first one of tag 3; else the points as given.
    """
    if board.squares is not None:
        across, down = (n - 1 for n in board.squares)
        grid = [(x + 1, y + 1, 0) for y in range(down) for x in range(across)]
        points = np.array(grid, dtype=float) * (board.pitch_mm or 0.0)
        return tuple(map(str, range(len(points)))), points * _MM
    if board.tags is not None:
        across, down = board.tags
        side, pitch = board.tag_mm or 0.0, (board.tag_mm or 0.0) + (board.gap_mm or 0.0)
        corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * side
        at = np.array([(x, y, 0) for y in range(down) for x in range(across)]) * pitch
        names = [f"{board.first_tag + k}_{c}" for k in range(across * down) for c in range(4)]
        return tuple(names), (at[:, None] + corners).reshape(-1, 3) * _MM
    return tuple(board.points_mm), np.array(list(board.points_mm.values())) * _MM
