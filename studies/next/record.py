"""What ``posecal next`` proposes, and how it is told: go on with these poses, or stop, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias

from pydantic import model_validator

from studies import document as doc
from studies.document import PROBABILITY, Shown, listed, mm, plural
from studies.entries import JointValues, joint_columns, shown_joints
from studies.record import (
    Count,
    Entry,
    Envelope,
    From,
    Maybe,
    NotNegative,
    Number,
    Positive,
    Record,
)

if TYPE_CHECKING:
    from calib import Cell
    from doe import Onward
    from doe.ahead.onward import Aim

_MM = 1e3
Serves: TypeAlias = Literal["task", "causes", "both"]
Stop: TypeAlias = Literal[
    "goal", "beyond_reach", "averages", "settled", "nothing_found", "no_pose_helps"
]


class ProposedPose(JointValues):
    """A pose to be read next; serves : what it is for."""

    pose: Annotated[str, Shown("next pose")]
    serves: Annotated[Serves, Shown("for")]


class ExpectedAccuracy(Entry):
    """The error at the targets; most : what it exceeds once in twenty."""

    readings: Count
    task_rms_mm: NotNegative
    task_most_mm: NotNegative
    open: tuple[str, ...]


class RivalPair(Entry):
    """Two rivals, and how likely the true one is preferred: now, and with the poses read."""

    rivals: tuple[str, str]
    now: Annotated[Number, Shown("right choice now", PROBABILITY)]
    after: Annotated[Number, Shown("with these poses", PROBABILITY)]


class NextShares(Entry):
    """What poses for both do, as shares of what as many for one alone would."""

    causes: Annotated[Number, From("0")]
    task: Annotated[Number, From("1")]


class NextRecord(Record):
    """The next poses, or why there are none.

    stops : why an aim asks for no more
    now, after : for the task, after with as many poses for it alone
    forms : causes of which readings should show that they have another form, and how surely they do
    shares : where the poses are for both
    missed : how many poses could not be read
    verdict : of the diagnosis, where causes are asked for
    """

    command: Literal["next"] = "next"
    aim: Serves
    goal_mm: Positive | None
    done: bool
    stops: tuple[Stop, ...]
    poses: tuple[ProposedPose, ...]
    now: Annotated[ExpectedAccuracy | None, From("enough.steps.0")]
    after: ExpectedAccuracy | None
    lacking_mm: Annotated[Maybe, From("enough.lacking.rms")]
    verdict: Annotated[
        Literal["no_gap", "explained", "ambiguous", "unknown"] | None, From("diagnosis.verdict")
    ]
    doubts: tuple[RivalPair, ...]
    forms: tuple[RivalPair, ...] = ()
    shares: Annotated[NextShares | None, From("doubts.shares")] = None
    missed: Count = 0

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        if self.done != (not self.poses):
            raise ValueError("is done with poses to read, or not done without")
        if self.done and not self.stops:
            raise ValueError("is done without a reason")
        if (self.aim != "causes") != (self.now is not None):
            raise ValueError("now belongs to the aims task and both")
        return self


def next_record(
    found: Onward, aim: Aim, goal: float | None, missed: int, cell: Cell, made_from: Envelope
) -> NextRecord:
    """The record of a proposal; goal : m; missed : poses that could not be read."""
    poses, answer, doubts = found.poses, found.enough, found.doubts
    return NextRecord.from_result(
        found,
        **made_from,
        warnings=(),
        aim=aim,
        goal_mm=None if goal is None else goal * _MM,
        poses=[
            ProposedPose(pose=name, serves=found.serves, **shown_joints(cell.robot, q))
            for name, q in zip(poses.names, poses.q, strict=True)
        ],
        after=None if answer is None or not answer.fresh else answer.fresh[-1],
        doubts=() if doubts is None else doubts.predictions,
        forms=() if doubts is None else doubts.forms,
        missed=missed,
    )


def next_table(found: Onward, cell: Cell) -> str:
    """The poses as a plan."""
    from calib.files.write_tables import plan_csv

    return plan_csv(cell, found.poses)


_DIAGNOSED = {
    "no_gap": "The diagnosis finds no unmodelled error so far.",
    "explained": "The model lacks causes that the diagnosis finds. Run `posecal diagnose --cell-out`.",
    "ambiguous": "The model lacks something; several causes fit. Run `posecal diagnose`.",
    "unknown": "The model lacks something of unknown cause. Run `posecal diagnose`.",
}
_STOPS = {
    "goal": "the goal is reached, 19 times in 20",
    "beyond_reach": "more poses will not reach the goal",
    "averages": "more poses would only average noise",
    "settled": "no causes are left to tell apart",
    "nothing_found": "no cause in the catalogue explains the error",
    "no_pose_helps": "no pose tells the remaining causes apart",
}


def told(record: NextRecord) -> doc.Document:
    """Go on or stop, the poses, and what is expected of them."""
    section = doc.Section("next", "What to measure next", tuple(_parts(record)))
    return doc.Document(tuple(_headline(record)), (section,))


def _headline(record: NextRecord) -> Iterator[doc.Sentence]:
    why = " and ".join(_STOPS[stop] for stop in record.stops)
    if record.done:
        mood: doc.Mood = "good" if {"goal", "settled", "averages"} & {*record.stops} else "warn"
        yield doc.Sentence(f"Stop: {why}.", mood)
    else:
        own = {name for p in record.poses for name in _SERVES_BOTH.get(p.serves, (p.serves,))}
        serves = " and ".join(name for name in ("causes", "task") if name in own)
        yield doc.Sentence(
            f"Measure {plural(len(record.poses), 'pose')} more, for {serves}.", "next"
        )
        if why:
            yield doc.Sentence(f"{why[0].upper()}{why[1:]}.")
    now, after = record.now, record.after
    if now is not None:
        goal = "" if record.goal_mm is None else f" (goal {record.goal_mm:g} mm)"
        yield doc.Sentence(
            f"Expected error at the targets now: {mm(now.task_rms_mm)} RMS, below "
            f"{mm(now.task_most_mm)} 19 times in 20{goal}."
        )
    if now is not None and now.open:
        yield doc.Sentence(f"Not identifiable yet: {listed(now.open, 5)}.", "warn")
    if record.shares is not None:
        yield doc.Sentence(
            f"A compromise: {100.0 * record.shares.causes:.0f} % as good for the diagnosis, "
            f"{100.0 * record.shares.task:.0f} % for accuracy, as poses for one alone."
        )
    elif after is not None and not record.done:
        more = after.readings - (0 if now is None else now.readings)
        yield doc.Sentence(f"After {plural(more, 'reading')} more: {mm(after.task_rms_mm)} RMS.")
    if record.verdict is not None:
        yield doc.Sentence(_DIAGNOSED[record.verdict])


def _parts(record: NextRecord) -> Iterator[doc.Part]:
    joints = joint_columns(record.poses, detail=False)
    columns = doc.columns(ProposedPose, "pose", *joints, "serves")
    yield doc.Table(columns, record.poses, "Poses to measure next")
    yield doc.Table(_DOUBTS, record.doubts, "Causes to tell apart")
    yield doc.Table(_FORMS, record.forms, "Causes whose form is not checked yet")


_SERVES_BOTH = {"both": ("causes", "task")}
_DOUBTS = doc.columns(
    RivalPair, doc.Column("causes to tell apart", lambda row: " or ".join(row.rivals)), "now after"
)
_FORMS = doc.columns(
    RivalPair,
    doc.Column("cause found", lambda row: row.rivals[0]),
    doc.Column("form checked now", lambda row: row.now, doc.PROBABILITY),
    "after",
)
