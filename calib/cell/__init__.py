"""What a cell file says, in SI: the arm, what measures it, what is asked of a plan, and the targets."""

from calib.cell.cell import Cell
from calib.cell.planned import Load, Repeatability

__all__ = ["Cell", "Load", "Repeatability"]
