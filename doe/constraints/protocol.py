"""What a constraint is: a yes or no for each configuration of a scene.

A new constraint is one file with one such class and a function that makes it from a cell, None where
it cannot act, and one entry in ``doe.constraints.constraints_of``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from calib.arrays import Mask
from doe.constraints.scene import Scene


class Constraint(ABC):
    """Something that forbids configurations.

    name : str, short and unique in a cell: the key under which removed configurations are counted
    """

    name: str

    @abstractmethod
    def allows(self, scene: Scene) -> Mask:
        """Whether each of the n configurations may be measured, shape (n,)."""
