"""What identify and diagnose begin with: a cell, its table, and which of its poses take no part."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from studies.command.holdout import Held, held_out

if TYPE_CHECKING:
    from calib import Cell, Measurements


@dataclass(frozen=True, eq=False)
class Session:
    """A table of a cell, read.

    whole : every pose of it; held : those that are fitted, and those that are held out
    holdout, seed : as the user gave them
    """

    cell: Cell
    data_path: Path
    whole: Measurements
    held: Held
    holdout: str | None
    seed: int

    @property
    def named(self) -> list[Path]:
        """What else the cell names: its targets, and what the robot's type knows."""
        return list(self.cell.named_files)

    @property
    def read(self) -> list[Path]:
        """Cell, robot and table."""
        return [self.cell.path, *self.cell.robot_files, self.data_path]


def read_session(cell: Cell, data_path: Path, holdout: str | None, seed: int) -> Session:
    """Read a table and hold poses out. Raises InputError."""
    import calib

    whole = calib.load_measurements(cell, data_path)
    held = held_out(cell, whole, holdout, seed, data_path)
    return Session(cell, data_path, whole, held, holdout, seed)
