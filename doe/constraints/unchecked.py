"""What no constraint can keep clear: an arm whose shape nobody gave, or whose meshes are absent."""

from __future__ import annotations

from calib.cell import Cell
from doe.constraints.scene import moving_capsules

_REMEDY = "Put the meshes where the robot file says, or give robot.capsules_mm in the cell."


def unchecked(cell: Cell) -> str:
    """That poses are not checked for collisions, or only in part, and what to do; "" where they are."""
    if cell.shapes.unread:
        more = f", and {len(cell.shapes.unread) - 1} more" if len(cell.shapes.unread) > 1 else ""
        what = f"shapes cannot be read: {cell.shapes.unread[0]}{more}"
        how = "only in part" if moving_capsules(cell) else "not"
        return f"The poses are {how} checked for collisions, as {what}. {_REMEDY}"
    if not moving_capsules(cell):
        return (
            "The poses are not checked for collisions, as the arm has no shape. Give "
            "robot.capsules_mm in the cell."
        )
    return ""
