"""Results of commands that write files: init, import, program, report and demo."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import Field

from calib.files.robot import Proposal
from studies.results.base import Count, Entry, Envelope, InputFile, NotNegative, Result


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
        return cls.from_object(
            found,
            **made_from,
            warnings=found.lacks,
            table=str(table),
            name=name,
            robot=ProposedArm.from_object(robot, form=found.robot.source.form),
            joints=robot.joints,
            others=robot.others,
        )

    @property
    def tips(self) -> list[str]:
        """Every tip."""
        return [self.robot.tip, *self.others]


class ImportResult(Result):
    """Points and joints as one table; markers : name -> points; runs : of motions, name -> rows."""

    of_one_cell: ClassVar[bool] = False
    command: Literal["import"] = "import"
    poses: Count
    points: Count
    markers: dict[str, Count]
    columns: tuple[str, ...]
    joint_columns: tuple[str, ...] = ()
    runs: dict[str, Count] = Field(default_factory=dict)


class ProgramResult(Result):
    """A plan as a robot program: the file, the poses by their names in it, the number of stops."""

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count


class ReportResult(Result):
    """A page of results, which are its inputs.

    page : the file; notes : what had to be left out of it
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["report"] = "report"
    page: str
    notes: tuple[str, ...]


class DemoStep(Entry):
    """A step, what it says, and how long it took."""

    step: str
    says: str
    seconds: NotNegative


class DemoResult(Result):
    """A demonstration in a folder.

    withheld : the error that was hidden; files : what it wrote, by name and content
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["demo"] = "demo"
    folder: str
    withheld: str
    steps: tuple[DemoStep, ...]
    files: tuple[InputFile, ...]
