"""The whole file, and what must hold between its tables."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import Field, model_validator

from calib.files.schema.camera import CameraTable
from calib.files.schema.carried import GravityTable, LoadTable, PayloadTable
from calib.files.schema.design import DesignTable
from calib.files.schema.instruments import AnyInstrument, InstrumentTable
from calib.files.schema.markers import BoardTable, BodyTable, KnownDistanceTable, Marker
from calib.files.schema.model import AcceptanceTable, DiagnosisTable, ModelTable
from calib.files.schema.robot import RobotTable
from calib.files.schema.told import Told
from calib.files.schema.values import Name, Table


class CellFile(Table):
    """The whole file."""

    format: Literal[1] = Field(alias="schema")
    name: Name | None = None
    robot: RobotTable
    markers_mm: dict[Name, Marker] = {}
    bodies: dict[Name, BodyTable] = {}
    boards: dict[Name, BoardTable] = {}
    instrument: InstrumentTable | None = None
    instruments: dict[Name, AnyInstrument] = {}
    known_distances: list[KnownDistanceTable] = []
    gravity: GravityTable = GravityTable()
    payload: PayloadTable = PayloadTable()
    load: LoadTable | None = None
    design: DesignTable = DesignTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
    acceptance: AcceptanceTable | None = None
    report: dict[Name, Told] = {}
    model: ModelTable

    @model_validator(mode="after")
    def _load_once(self) -> Self:
        own, load = self.payload, self.load
        if load is None or not own.mass_kg or own.com_mm != load.com_mm:
            return self
        if math.isclose(own.mass_kg, load.mass_kg, rel_tol=0.01):
            raise ValueError(
                "[payload] and [load] are the same mass at the same place; it counts once: keep "
                "[payload] if it is carried at every pose, [load] if it is hung on for a second reading"
            )
        return self

    @model_validator(mode="after")
    def _something_read(self) -> Self:
        if self.instrument is None and not self.instruments:
            raise ValueError(
                "has no [instrument]; add it, as in the cell that `posecal demo` writes"
            )
        if self.instrument is not None and self.instruments:
            raise ValueError(
                "has [instrument] and [instruments]; make [instrument] one of these, too"
            )
        kinds = {entry.kind for entry in self.instruments.values()} or {"points"}
        touching = kinds - {"pose", "camera"}
        if touching and not self.markers_mm:
            raise ValueError(f"reads {min(touching)} and has no [markers_mm]; add what is read")
        if "pose" in kinds and not self.bodies:
            raise ValueError("reads pose and has no [bodies]; add what is read")
        if self.bodies and "pose" not in kinds:
            raise ValueError("has [bodies] and no instrument of kind pose that reads them")
        if self.markers_mm and not touching and not self._cameras("world"):
            raise ValueError("has [markers_mm] and no instrument that reads them")
        self._check_boards()
        return self

    def _cameras(self, on: str) -> list[str]:
        tables = self.instruments.items()
        return [name for name, own in tables if isinstance(own, CameraTable) and own.on == on]

    def _check_boards(self) -> None:
        """Each camera sees what stands on the other side, and each board is seen."""
        boards = {
            on: [n for n, own in self.boards.items() if own.on == on] for on in ("tip", "world")
        }
        if (seeing := self._cameras("world")) and not boards["tip"] and not self.markers_mm:
            raise ValueError(
                f"has camera {seeing[0]} in the world and nothing on the tip; add [boards.NAME] with "
                "on = 'tip', or [markers_mm]"
            )
        if (seeing := self._cameras("tip")) and not boards["world"]:
            raise ValueError(
                f"has camera {seeing[0]} on the tip and nothing in the world; add [boards.NAME] with "
                "on = 'world'"
            )
        for on, other in (("tip", "world"), ("world", "tip")):
            if boards[on] and not self._cameras(other):
                raise ValueError(
                    f"has board {boards[on][0]} on the {on} and no camera on the {other} that sees it"
                )
        named = [*self.markers_mm, *self.bodies, *self.boards, *self._cameras("tip")]
        if len(named) > len(set(named)):
            twice = next(name for name in named if named.count(name) > 1)
            raise ValueError(f"{twice!r} names two things; rename one")
