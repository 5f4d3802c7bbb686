"""Cells with one camera that sees one board on the tip."""

from __future__ import annotations


def camera_cell(
    board: str, camera: str, urdf: str = "r.urdf", base: str = "base", tip: str = "tip"
) -> str:
    """The text of a cell.

    board, camera : keys of ``[boards.b]`` and ``[instruments.cam]``, beside those that all share
    """
    return f"""schema = 1
[robot]
urdf = "{urdf}"
base = "{base}"
tip = "{tip}"
[boards.b]
on = "tip"
{board}
[instruments.cam]
kind = "camera"
{camera}
[model]
effects = ["base", "tool"]
"""


PINHOLE = "focal_px = 1000\ncenter_px = [479.5, 359.5]\nsigma_px = 0.1"
"""The camera of :mod:`tests.photographs`."""
