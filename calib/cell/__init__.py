"""What a cell file says, in SI: the arm, what measures it, what is asked of a plan, and the targets."""

from calib.cell.cell import FORMS, Capsule, Cell, Form, Load, Repeatability, Shapes

__all__ = ["FORMS", "Capsule", "Cell", "Form", "Load", "Repeatability", "Shapes"]
