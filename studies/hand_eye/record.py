"""What ``posecal hand-eye`` finds: errors by method, where cameras sit, what more poses bring."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from calib.handeye.opencv import Method
from studies.document import FOUR, Rule, Shown
from studies.entries import JointValues, check_same_joints, shown_joints
from studies.identify.parameters import UnfitLensEntry
from studies.record import (
    Count,
    Entry,
    Envelope,
    From,
    IntervalEntry,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Record,
    Three,
)

if TYPE_CHECKING:
    from calib import Cell, HandEye, Measurements
    from calib.handeye.judge import Standing
    from doe import Enough

_MM = 1e3
_MORE = 10  # poses that are tried where no goal is given
_SHOWN = 3  # poses to go to next

_FIGURE = Rule(lambda own: FOUR(own.value))


class MethodEntry(Entry):
    """What a method misses at the held-out poses; None in units that are not read, or without result.

    px : RMS distance of a point; mm, mrad : RMS of place and turn of the target as the image shows it
    used : whether this is the result to use
    better_p : probability by chance that it misses as much less than that
    """

    camera: Annotated[str, From("pair.camera")]
    target: Annotated[str, From("pair.target")]
    method: Method
    used: bool
    images: Annotated[Count, From("missed.group")]
    px: Annotated[IntervalEntry | None, Shown("points", _FIGURE, "px")]
    mm: Annotated[IntervalEntry | None, Shown("place", _FIGURE, "mm")]
    mrad: Annotated[IntervalEntry | None, Shown("turn", _FIGURE, "mrad")]
    better_p: Annotated[Maybe, From("better")]


class CameraEntry(Entry):
    """Where a camera sits: its frame has z ahead and x to the right of the image.

    on : the link that carries it; std, ci95 : standard deviation, and half of the 95 % interval, of
        x, y, z along the axes of the link, and of the turn about those of the camera
    image_px : RMS distance of a point that an image by itself leaves; None where poses are read
    """

    camera: str
    on: str
    position_mm: Three
    rpy_deg: Three
    quaternion_xyzw: tuple[Number, Number, Number, Number]
    std_mm: tuple[MaybePositive, MaybePositive, MaybePositive]
    std_mrad: tuple[MaybePositive, MaybePositive, MaybePositive]
    ci95_mm: tuple[MaybePositive, MaybePositive, MaybePositive]
    ci95_mrad: tuple[MaybePositive, MaybePositive, MaybePositive]
    image_px: Maybe


class AheadEntry(Entry):
    """The error at the targets.

    most : what it exceeds once in twenty; open : parameters that cannot be told by then
    """

    readings: Count
    task_rms_mm: NotNegative
    task_most_mm: NotNegative
    open: tuple[str, ...]


class PoseToMeasure(JointValues):
    """A pose to measure next."""

    pose: Annotated[str, Shown("next pose")]


class HandEyeRecord(Record):
    """Where cameras sit, how good that is, and what limits it.

    crossed : whether each fifth of the poses was predicted from the others; else poses were held out
    arm_calibrated : whether the result to use has the arm calibrated
    arm_p : probability by chance that its calibration lowers the errors as much; None where untold
    arm_untold : why
    unfit_lenses : cameras whose lens is to be freed before anything is said of the arm
    opencv : why methods of OpenCV are missing, empty where they are there
    ahead : what is expected now, then after each further pose; empty where ``ahead_untold`` says why
    poses_to_goal : None where no goal is given, or no number of poses tried reaches it
    """

    command: Literal["hand-eye"] = "hand-eye"
    poses: Count
    crossed: bool
    arm_calibrated: Annotated[bool, From("calibrated")]
    arm_p: Annotated[Maybe, From("p")]
    arm_untold: Annotated[str, From("why")]
    unfit_lenses: Annotated[tuple[UnfitLensEntry, ...], From("lenses")] = ()
    opencv: Annotated[str, From("left_out")]
    methods: tuple[MethodEntry, ...] = Field(min_length=1)
    cameras: tuple[CameraEntry, ...] = Field(min_length=1)
    targets: Annotated[str, From("cell.targets_in_words")]
    goal_mm: Positive | None
    goal_beyond_reach: bool
    poses_to_goal: Count | None
    lacking_mm: Annotated[Maybe, From("enough.lacking.rms")]
    ahead: tuple[AheadEntry, ...]
    ahead_untold: str
    next_poses: tuple[PoseToMeasure, ...]

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        check_same_joints(self.next_poses)
        cameras = {own.camera for own in self.cameras}
        if {own.camera for own in self.methods if own.used} != cameras:
            raise ValueError("cameras are not those of the methods in use")
        if bool(self.ahead) == bool(self.ahead_untold):
            raise ValueError("ahead is empty without ahead_untold, or both are given")
        return self


class Ahead(NamedTuple):
    """What more poses bring: of ``doe.enough``, or why it is not foreseen."""

    enough: Enough | None
    why: str

    def table(self, path: Path, cell: Cell) -> dict[Path, str | bytes]:
        """The next poses as a plan; none where there are none."""
        from calib.files.write_tables import plan_csv
        from doe.plan import named

        if self.enough is None or not len(self.enough.fresh_q):
            return {}
        poses = named(self.enough.fresh_q, "n")
        return {path: plan_csv(cell, poses)}


def next_poses(
    found: HandEye, data: Measurements, heldout: Measurements | None, goal: float | None, seed: int
) -> Ahead:
    """Poses beyond those measured, with the model in use; goal : m."""
    import doe
    from calib.errors import CalibError
    from doe.ahead.forecast import as_found

    cell = as_found(found.cell, found.found)
    fresh = _MORE if goal is None else 0
    try:
        answer = doe.enough(cell, data, heldout=heldout, goal=goal, fresh=fresh, seed=seed)
    except CalibError as error:
        return Ahead(None, str(error))
    return Ahead(answer, "")


def hand_eye_record(
    found: HandEye,
    ahead: Ahead,
    goal: float | None,
    made_from: Envelope,
    warnings: tuple[str, ...] = (),
) -> HandEyeRecord:
    """The record of a result; goal : m."""
    answer, robot = ahead.enough, found.cell.robot
    steps = () if answer is None else (answer.steps[0], *answer.fresh)
    q = np.zeros((0, robot.dof)) if answer is None else answer.fresh_q[:_SHOWN]
    return HandEyeRecord.from_result(
        found,
        ahead,
        **made_from,
        warnings=tuple(dict.fromkeys((*warnings, *found.found.warnings))),
        methods=[
            MethodEntry.from_result(
                own,
                used=own.method == found.used,
                **{unit: own.missed.rms(unit) for unit in ("px", "mm", "mrad")},
            )
            for own in found.judged
        ],
        cameras=[_camera(own, found) for own in found.standing],
        goal_mm=None if goal is None else goal * _MM,
        goal_beyond_reach=answer is not None and answer.beyond_reach,
        poses_to_goal=_to_goal(answer),
        ahead=steps,
        ahead_untold=ahead.why,
        next_poses=[
            PoseToMeasure(pose=f"n{k:02d}", **shown_joints(robot, own))
            for k, own in enumerate(q, 1)
        ],
    )


def _to_goal(answer: Enough | None) -> int | None:
    if answer is None or answer.goal is None:
        return None
    return 0 if answer.needed == 0 else answer.fresh_needed


def _camera(own: Standing, found: HandEye) -> CameraEntry:
    from scipy.spatial.transform import Rotation

    from calib.arm.se3 import rpy_from_rotation

    robot = found.cell.robot
    R = own.T[:3, :3]
    std, half = own.std * _MM, own.half * _MM
    return CameraEntry.from_result(
        own,
        {"position": own.T[:3, 3], "rpy": rpy_from_rotation(R)},
        on=robot.tip if own.carrier == "tip" else robot.base,
        quaternion_xyzw=Rotation.from_matrix(R).as_quat(),
        std_mm=std[:3],
        std_mrad=std[3:],
        ci95_mm=half[:3],
        ci95_mrad=half[3:],
        image_px=found.alone.get(own.camera),
    )
