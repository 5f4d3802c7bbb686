"""Plans that cannot be: why, and what would help."""

from __future__ import annotations

import numpy as np

from calib.cell import Cell
from calib.errors import CalibError
from calib.poses import Poses
from doe.levels import Levels

_OUTSIDE = 1e-4  # rad or m: rounding of limits


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


def no_candidate(count: int, removed: dict[str, int], where: str = "") -> str:
    """Why nothing is left to choose from."""
    causes = sorted(((n, name) for name, n in removed.items() if n), reverse=True)
    said = ", ".join(f"{name} removed {n}" for n, name in causes) or "nothing was drawn"
    return f"no feasible candidate{where}: of {count}, {said}; relax what removed most"


def at_level(cell: Cell, levels: Levels | None, level: int) -> str:
    """Words for one level, none without levels."""
    if levels is None:
        return ""
    value, joint = levels.values[level], levels.joint
    slides = cell.robot.prismatic[joint]
    shown = f"{value * 1e3:g} mm" if slides else f"{np.degrees(value):g} deg"
    return f" at {cell.robot.joints[joint]} = {shown}"


def check_targets(cell: Cell, targets: Poses) -> None:
    """Refuse targets outside the joint limits. Raises CalibError."""
    low, high = cell.robot.limits.T
    outside = (targets.q < low - _OUTSIDE) | (targets.q > high + _OUTSIDE)
    for i, j in np.argwhere(outside)[:1]:
        slides = cell.robot.prismatic[j]
        unit, name = (1e-3, "mm") if slides else (np.pi / 180.0, "deg")
        raise CalibError(
            f"target {targets.names[i]}: {cell.robot.joints[j]} at {targets.q[i, j] / unit:.2f} {name} "
            f"is outside its limits {low[j] / unit:.2f} .. {high[j] / unit:.2f}; move it inside"
        )
