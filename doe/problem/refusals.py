"""Plans that cannot be: why, and what would help."""

from __future__ import annotations

import numpy as np

from calib.cell import Cell
from calib.errors import CalibError
from doe.problem.levels import Levels


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


def refuse_unplaced(cell: Cell) -> None:
    """Raise CalibError where an instrument reads nothing that can be foreseen."""
    for instrument in cell.instruments:
        if instrument.unforeseen:
            raise CalibError(
                f"what {instrument.kind} {instrument.name!r} would read cannot be foreseen: "
                f"{instrument.unforeseen}"
            )


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
