"""What ``posecal next`` proposes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self, TypeAlias

import numpy as np
from pydantic import model_validator

from studies.joints import JointValues, check_same_joints, shown_joints
from studies.record import Count, Entry, Envelope, Maybe, NotNegative, Number, Positive, Record

if TYPE_CHECKING:
    from calib import Cell
    from doe import Onward
    from doe.ahead.onward import Aim

_MM = 1e3
Stop: TypeAlias = Literal[
    "goal", "beyond_reach", "averages", "settled", "nothing_found", "no_pose_helps"
]


class ProposedPose(JointValues):
    """A pose to be read next; serves : what it is for."""

    pose: str
    serves: Literal["task", "causes", "both"]


class ExpectedAccuracy(Entry):
    """The error at the targets; most : what it exceeds once in twenty."""

    readings: Count
    task_rms_mm: NotNegative
    task_most_mm: NotNegative
    open: tuple[str, ...]


class RivalPair(Entry):
    """Two rivals, and how likely the true one is preferred: now, and with the poses read."""

    rivals: tuple[str, str]
    now: Number
    after: Number


class NextShares(Entry):
    """What poses for both do, as shares of what as many for one alone would."""

    causes: Number
    task: Number


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
    aim: Literal["task", "causes", "both"]
    goal_mm: Positive | None
    done: bool
    stops: tuple[
        Literal["goal", "beyond_reach", "averages", "settled", "nothing_found", "no_pose_helps"],
        ...,
    ]
    poses: tuple[ProposedPose, ...]
    now: ExpectedAccuracy | None
    after: ExpectedAccuracy | None
    lacking_mm: Maybe
    verdict: Literal["no_gap", "explained", "ambiguous", "unknown"] | None
    doubts: tuple[RivalPair, ...]
    forms: tuple[RivalPair, ...] = ()
    shares: NextShares | None = None
    missed: Count = 0

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        check_same_joints(self.poses)
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
    shares = None if doubts is None else doubts.shares
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
        now=None if answer is None else answer.steps[0],
        after=None if answer is None or not answer.fresh else answer.fresh[-1],
        lacking_mm=None if answer is None else answer.lacking.rms * _MM,
        verdict=None if found.diagnosis is None else found.diagnosis.verdict,
        doubts=() if doubts is None else doubts.predictions,
        forms=() if doubts is None else doubts.forms,
        shares=None if shares is None else NextShares(causes=shares[0], task=shares[1]),
        missed=missed,
    )


def next_table(found: Onward, cell: Cell) -> str:
    """The poses as a plan."""
    from calib.files.write_tables import plan_csv

    return plan_csv(cell, found.poses, np.full(len(found.poses), np.nan))
