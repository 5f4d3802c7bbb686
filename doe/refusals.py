"""Plans that cannot be: why, and what would help."""

from __future__ import annotations

import numpy as np

from calib.cell import Cell
from calib.errors import CalibError
from doe.levels import Levels


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
