"""The tables of a cell that stand for instruments and for frames that ride on a link."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.instruments.protocol import TIP, WORLD, Instrument
from calib.keys import MM, Name, TomlTable, Vector

if TYPE_CHECKING:
    from calib.instruments.board import BoardTable


class RidingTable(TomlTable):
    """The table of something that may ride on a link of the robot."""

    on: Name = TIP
    """link on which it rides, where that is not the tip"""


class BodyTable(RidingTable):
    """A frame."""

    position_mm: Vector = (0.0, 0.0, 0.0)
    """rough position in the frame of its link, or the world"""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """rough orientation: roll, pitch, yaw"""

    @property
    def frame(self) -> Array:
        """Where it stands, shape (4, 4), m."""
        return from_xyz_rpy(np.array(self.position_mm) * MM, np.radians(self.rpy_deg))

    @property
    def stated(self) -> bool:
        """Whether the cell says where it stands."""
        return {"position_mm", "rpy_deg"} <= self.model_fields_set


@dataclass(frozen=True, eq=False)
class CellParts:
    """What of a cell an instrument may read or stand by.

    links : tuple of str, on which the cell's own markers ride, in their order
    parts : dict, body -> slice, its points among all markers
    read_as_poses : dict, body that is a frame -> the link on which it rides
    boards : dict, board -> its table, the names of its points, and these points (n, 3), m, in its frame
    placed : whether the model has places of instruments: what a cell gives of them is a guess
    """

    links: tuple[str, ...]
    parts: Mapping[str, slice]
    read_as_poses: Mapping[str, str]
    boards: Mapping[str, tuple[BoardTable, tuple[str, ...], Array]]
    placed: bool

    def read_from(self, link: str) -> tuple[int, ...] | None:
        """Positions among all markers of the cell's own that ride elsewhere; None for all there are."""
        own = tuple(j for j, on in enumerate(self.links) if on != link)
        return own if self.parts or len(own) < len(self.links) else None


class KeysTable(RidingTable, ABC):
    """The table ``[instruments.NAME]`` of one kind: its fields are those of the instrument, in SI.

    makes : the instrument; rides : whether one may stand on a link of the robot
    """

    reads: ClassVar[Literal["markers", "bodies", "boards"]] = "markers"
    rides: ClassVar[bool] = True
    makes: ClassVar[type[Instrument]]
    kind: str
    on: Name = WORLD
    """where it is fixed: world, tip, or a link of the robot"""

    @model_validator(mode="after")
    def _rides(self) -> Self:
        if self.on != WORLD and not self.rides:
            raise ValueError(f"a {self.kind} rides on no link; take out on = {self.on!r}")
        return self

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the instrument that the table gives."""
        return {own: getattr(self, own) for own in type(self).model_fields.keys() - {"kind", "on"}}

    def instrument(self, name: str, cell: CellParts) -> Instrument:
        """The instrument, in SI."""
        return self.makes(name=name, markers=cell.read_from(self.on), **self.fields)
