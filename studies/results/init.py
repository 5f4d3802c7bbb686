"""The JSON of ``posecal init``: the arm as its file describes it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field

from studies.results.base import Entry, Envelope, Result

if TYPE_CHECKING:
    from calib.files.proposal import Proposal


class ProposedArm(Entry):
    """The form of the file, and where the arm begins and ends."""

    form: Literal["urdf", "mjcf", "dh"]
    base: str
    tip: str


class InitResult(Result):
    """A first cell for a robot: files, joints, and others that are held at zero.

    others : further tips of the robot
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["init"] = "init"
    table: str
    name: str
    robot: ProposedArm
    joints: tuple[str, ...] = Field(min_length=1)
    held: tuple[str, ...]
    others: tuple[str, ...]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, found: Proposal, name: str, table: Path, made_from: Envelope) -> Self:
        """What was proposed for the cell in ``made_from``."""
        robot = found.robot
        return cls(
            **made_from,
            warnings=found.lacks,
            table=str(table),
            name=name,
            robot=ProposedArm(form=found.form, base=robot.base, tip=robot.tip),
            joints=robot.joints,
            held=found.held,
            others=robot.others,
            notes=found.notes,
        )

    @property
    def tips(self) -> list[str]:
        """Every tip."""
        return [self.robot.tip, *self.others]
