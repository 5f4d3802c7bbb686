"""What a hand-eye calibration says: which result to use, how good it is, what limits it, what to do."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

from studies import document as doc
from studies.document import FOUR, STD, Shown, mm, plural
from studies.entries import joint_columns
from studies.hand_eye.record import CameraEntry, HandEyeRecord, MethodEntry, PoseToMeasure
from studies.record import IntervalEntry

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
