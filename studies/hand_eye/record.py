"""What ``posecal hand-eye`` finds and says: errors by method, where cameras sit, what limits them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from calib.handeye.opencv import Method
from studies import document as doc
from studies.document import FOUR, STD, Rule, Shown, mm, plural
from studies.entries import JointValues, joint_columns, shown_joints
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


_OURS = ("arm as it is", "arm calibrated")
_ONE_OF_MANY = 0.01  # by chance: of five methods one is better at one in twenty
_END = doc.Rule(FOUR.show, absent="open")
_LIMITED = 1.5  # times what images leave by themselves: above, something else limits
_LESS = 0.8  # times the error: above, the arm is not what limits
_SAME = 1.02  # times: no engineer cares for less


def told(record: HandEyeRecord) -> doc.Document:
    """The answer, the methods side by side, and where the cameras sit."""
    section = doc.Section("hand-eye", "Hand-eye calibration", tuple(_parts(record)))
    sentences = (_use, _good, _others, _limit, _more)
    return doc.Document(tuple(chain.from_iterable(say(record) for say in sentences)), (section,))


def _figure(entry: MethodEntry) -> tuple[IntervalEntry, str] | None:
    """By what it is judged: pixels where a camera reads, else lengths."""
    if entry.px is not None:
        return entry.px, "px"
    return None if entry.mm is None else (entry.mm, "mm")


def _value(entry: MethodEntry) -> float:
    figure = _figure(entry)
    return float("inf") if figure is None else figure[0].value


def _said(entry: MethodEntry) -> str:
    figure = _figure(entry)
    return "" if figure is None else f"{FOUR(figure[0].value)} {figure[1]}"


def _named(record: HandEyeRecord, entry: MethodEntry) -> str:
    several = len({(own.camera, own.target) for own in record.methods}) > 1
    return f"{entry.camera}: " if several else ""


def _use(record: HandEyeRecord) -> Iterator[doc.Sentence]:
    """Which result to use, and whether the arm limits it."""
    if record.unfit_lenses:
        yield from (doc.Sentence(own.said, "next") for own in record.unfit_lenses)
        yield doc.Sentence("Whether the arm limits this hand-eye is known after that.")
        return
    judged = [own for own in record.methods if _figure(own) is not None]
    plain, whole = ([own for own in judged if own.method == method] for method in _OURS)
    fell = [
        f"{_named(record, a)}{FOUR(_value(a))} to {_said(b)}"
        for a, b in zip(plain, whole, strict=False)
    ]
    if record.arm_calibrated:
        limits = all(_value(b) < _LESS * _value(a) for a, b in zip(plain, whole, strict=True))
        why = "The arm limits this hand-eye" if limits else "The arm's geometry matters a little"
        yield doc.Sentence(
            f"{why}. Calibrate the arm as well (`posecal identify .. --urdf`): the error at held-out "
            f"poses falls from {', '.join(fell)}.",
            "next",
        )
        yield doc.Sentence("The camera's place below holds for the calibrated arm only.")
        return
    yield doc.Sentence("Use the camera's place below, with the arm as its file has it.", "good")
    if record.arm_p is None:
        why = record.arm_untold
        yield doc.Sentence(f"Whether the arm limits it is not known: {why}.", "warn")
    elif fell:
        yield doc.Sentence(
            "Calibrating the arm as well does not lower the error at held-out poses beyond chance: "
            f"from {', '.join(fell)}."
        )


def _good(record: HandEyeRecord) -> Iterator[doc.Sentence]:
    """What to expect at poses that nobody saw."""
    for own in record.methods:
        if own.used and own.images:
            parts = [
                f"{FOUR(figure.value)} {unit} ({FOUR(figure.low)} to {_END(figure.high)})"
                for figure, unit in ((own.px, "px"), (own.mm, "mm"), (own.mrad, "mrad"))
                if figure is not None
            ]
            yield doc.Sentence(
                f"{_named(record, own)}At other poses like these expect {', '.join(parts)} RMS. The "
                "ranges hold 19 times in 20."
            )


def _others(record: HandEyeRecord) -> Iterator[doc.Sentence]:
    """OpenCV's methods, beside the result in use."""
    if record.opencv:
        yield doc.Sentence(f"{record.opencv}.", "note")
        return
    for used in record.methods:
        if not used.used:
            continue
        own = [
            e
            for e in record.methods
            if (e.camera, e.target) == (used.camera, used.target) and e.method not in _OURS
        ]
        there = sorted((e for e in own if _figure(e) is not None), key=_value)
        none = [e.method for e in own if _figure(e) is None]
        lost = f" {doc.listed(none)} found no result." if none else ""
        if not there:
            yield doc.Sentence(f"{_named(record, used)}OpenCV's methods found no result.")
            continue
        best, worst = there[0], there[-1]
        beats = best.better_p is not None and best.better_p < _ONE_OF_MANY
        if beats and _value(used) > _SAME * _value(best):
            yield doc.Sentence(
                f"{_named(record, used)}OpenCV's {best.method} is better here: {_said(best)} at "
                "held-out poses. The model lacks something. Run `posecal diagnose`.",
                "warn",
            )
            continue
        yield doc.Sentence(
            f"{_named(record, used)}OpenCV's five methods reach {_said(best)} ({best.method}) to "
            f"{_said(worst)} ({worst.method}).{lost}"
        )


def _limit(record: HandEyeRecord) -> Iterator[doc.Sentence]:
    """Whether images limit the result in use, where no lens is known to."""
    if record.unfit_lenses:
        return
    for camera in record.cameras:
        used = [own for own in record.methods if own.camera == camera.camera and own.used]
        worst = max((own.px.value for own in used if own.px is not None), default=None)
        if camera.image_px is None or worst is None or worst < camera.image_px / _LIMITED:
            continue
        image = (
            f"{_named(record, used[0])}One image by itself is good to {FOUR(camera.image_px)} px"
        )
        if worst <= _LIMITED * camera.image_px:
            yield doc.Sentence(f"{image}: the images limit the result.")
        else:
            yield doc.Sentence(
                f"{image}: the arm, the lens or the board limits the result. Run `posecal diagnose`."
            )


def _more(record: HandEyeRecord) -> Iterator[doc.Sentence]:
    """What more poses bring."""
    if record.ahead_untold:
        yield doc.Sentence(f"How many poses more is not foreseen: {record.ahead_untold}.", "note")
        return
    now, *later = record.ahead
    if now.open:
        yield doc.Sentence(
            f"These poses do not determine {doc.listed(now.open, 3)} yet. Measure the poses below.",
            "warn",
        )
        return
    at = f"Expected error at {record.targets}: {mm(now.task_rms_mm)} RMS now"
    if record.goal_mm is None:
        after = f", {mm(later[-1].task_rms_mm)} after {len(later)} poses more" if later else ""
        yield doc.Sentence(f"{at}{after}.")
        return
    yield doc.Sentence(f"{at}.")
    goal = f"The goal of {record.goal_mm:g} mm"
    if record.poses_to_goal == 0:
        yield doc.Sentence(f"{goal} is reached, 19 times in 20.", "good")
    elif record.poses_to_goal is not None:
        yield doc.Sentence(
            f"{goal} takes about {plural(record.poses_to_goal, 'pose')} more.", "next"
        )
    elif record.goal_beyond_reach:
        yield doc.Sentence(
            f"More poses will not reach {record.goal_mm:g} mm: {mm(record.lacking_mm)} remain "
            "unexplained. Run `posecal diagnose`.",
            "warn",
        )
    else:
        yield doc.Sentence(f"{goal} is out of reach of {len(later)} poses more.", "warn")


def _parts(record: HandEyeRecord) -> Iterator[doc.Part]:
    units = [u for u in ("px", "mm", "mrad") if any(getattr(own, u) for own in record.methods)]
    several = "camera target " if len({(o.camera, o.target) for o in record.methods}) > 1 else ""
    used = doc.Column[MethodEntry]("", lambda row: "use this" if row.used else "")
    how = "each fifth predicted from the others" if record.crossed else "held-out poses"
    yield doc.Table(
        doc.columns(MethodEntry, f"{several}method", *units, used),
        record.methods,
        "Methods at the same held-out poses",
        f"RMS, {how}. px: distance of a point. mm and mrad: place and turn of the target against what "
        "the image shows by itself, or against the pose that is read",
    )
    yield doc.Table(_COORDINATES, list(_coordinates(record)), "Where the camera sits")
    for camera in record.cameras:
        yield doc.Lines(_lines(camera))
    joints = joint_columns(record.next_poses, detail=False)
    yield doc.Table(
        doc.columns(PoseToMeasure, "pose", *joints), record.next_poses, "Poses to measure next"
    )


_VALUE = doc.Rule(lambda own: doc.to_std(*own), absent="")
_COORDINATES = doc.heads(
    "camera",
    "on",
    "coordinate",
    Shown("value", _VALUE),
    Shown("standard\ndeviation", STD),
    Shown("95 %", doc.Rule(lambda half: f"+- {STD(half)}", absent="open")),
    "unit",
)


def _coordinates(record: HandEyeRecord) -> Iterator[tuple[Any, ...]]:
    """Place and turn of each camera; deviations of a turn are about the camera's axes."""
    for own in record.cameras:
        rows = zip("xyz", own.position_mm, own.std_mm, own.ci95_mm, strict=True)
        for name, value, std, half in rows:
            yield own.camera, own.on, name, (value, std), std, half, "mm"
        for name, std, half in zip("xyz", own.std_mrad, own.ci95_mrad, strict=True):
            yield own.camera, own.on, f"turn about its {name}", None, std, half, "mrad"


def _lines(own: CameraEntry) -> str:
    """Where a camera sits, as a cell and ROS take it."""
    place = ", ".join(f"{value:.4f}" for value in own.position_mm)
    rpy = ", ".join(f"{value:.5f}" for value in own.rpy_deg)
    x, y, z = (f"{1e-3 * value:.7f}" for value in own.position_mm)
    qx, qy, qz, qw = (f"{value:.8f}" for value in own.quaternion_xyzw)
    return (
        f"# {own.camera}\nposition_mm = [{place}]\nrpy_deg = [{rpy}]\n"
        f"ros2 run tf2_ros static_transform_publisher --x {x} --y {y} --z {z} --qx {qx} --qy {qy} "
        f"--qz {qz} --qw {qw} --frame-id {own.on} --child-frame-id {own.camera}"
    )
