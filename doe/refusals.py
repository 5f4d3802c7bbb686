"""Plans that cannot be: why, and what would help."""

from __future__ import annotations

import numpy as np

from calib.cell import Cell
from calib.errors import CalibError, InputError
from calib.poses import Poses
from doe.levels import Levels

_OUTSIDE = 1e-4  # rad or m: rounding of limits


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


def no_candidate(
    count: int, removed: dict[str, int], where: str = "", found: int = 0, needed: int = 1
) -> str:
    """Why nothing, or too little, is left to choose from."""
    what = f"no feasible candidate{where}"
    if found:
        only = f"only {found} feasible candidate{'s' if found > 1 else ''}"
        what = f"{only}{where}, and {needed} are needed"
    causes = sorted(((n, name) for name, n in removed.items() if n), reverse=True)
    if not causes:
        return f"{what}; draw more, or allow repeats"
    said = ", ".join(f"{name} removed {n}" for n, name in causes)
    return f"{what}: of {count}, {said}; relax what removed most"


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
        where = cell.design.get("targets") or cell.path
        raise InputError(
            where,
            f"target {targets.names[i]}",
            f"{cell.robot.joints[j]} at {targets.q[i, j] / unit:.2f} {name} "
            f"is outside its limits {low[j] / unit:.2f} .. {high[j] / unit:.2f}",
            "move it inside",
        )
