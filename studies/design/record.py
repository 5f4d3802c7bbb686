"""What ``posecal design`` finds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from studies.day import DayEntry
from studies.document import FOUR, Shown
from studies.entries import (
    JointValues,
    shown_joints,
)
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    Envelope,
    From,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Record,
)

if TYPE_CHECKING:
    from doe import Design

_MM = 1e3


class BeforePolish(Entry):
    """The plan of candidates alone."""

    value: Maybe
    bound: Maybe
    efficiency: Number


class ProofEntry(Entry):
    """The certificate: what no plan surpasses, and how it was found."""

    weighted_value: Maybe
    solver_gap: Number
    before_polish: BeforePolish
    agreement_of_starts: Number
    surviving_candidates: Count
    rounds: Count


class DesignPose(JointValues):
    """A pose of the plan; level : deg or mm, None without levels."""

    pose: str
    level: Annotated[Maybe, Shown(detail=True)]


class PredictedStd(Entry):
    """How well the plan determines a parameter."""

    name: Annotated[str, Shown("parameter")]
    effect: str
    where: str
    id: str
    std: Annotated[Maybe, Shown("expected standard\ndeviation"), OWN_UNIT]
    unit: str


class PlanAccuracy(Entry):
    """What a plan is worth."""

    task_rms_mm: Maybe
    task_worst_mm: Maybe
    determinant: Maybe
    trace: Maybe
    observability: dict[str, Maybe]


class LossOfPose(Entry):
    """Without the pose that is worst to lose."""

    worst: str | None
    task_rms_mm: Maybe


class Survives(Entry):
    """What is left when something is lost; markers : task RMS without each, mm."""

    loss_of_pose: LossOfPose
    loss_of_marker: dict[str, Maybe]


class CandidatesEntry(Entry):
    """From how many poses the plan was chosen, and what removed the others."""

    drawn: Count
    feasible: Count
    removed_by: dict[str, Count]


class RelativeStd(Entry):
    """Standard deviation of the arm's repeatability over its size, as second visits show it."""

    common: Maybe
    translation: Maybe
    rotation: Maybe


class ReapproachesEntry(Entry):
    """Poses that are visited again, and the names of their second visits.

    asked : else planned by default
    """

    poses: tuple[str, ...]
    again: tuple[str, ...]
    dof: NotNegative
    repeatability_relative_std: RelativeStd
    asked: bool


class RivalPlan(PlanAccuracy):
    """A plan judged beside the result, by the same bound; std : of each parameter, in its unit."""

    poses: Count
    value: Maybe
    efficiency: Maybe
    std: tuple[Maybe, ...]


class CurveStepEntry(Entry):
    """The best plan found of so many poses."""

    poses: Annotated[int, Shown(rule=FOUR)] = Field(gt=0, lt=10**6)
    value: Maybe
    task_rms_mm: Annotated[MaybePositive, Shown("task RMS")]
    efficiency: Annotated[Maybe, Shown("efficiency\n(bound)")]


class DesignRecord(Record, PlanAccuracy):
    """The poses to measure, and the proof of how good they are."""

    command: Literal["design"] = "design"
    criterion: str
    criterion_unit: Annotated[str, From("problem.criterion.unit")]
    larger_is_better: Annotated[bool, From("problem.criterion.larger_is_better")]
    value: Maybe
    bound: Maybe
    efficiency: Number
    proof: ProofEntry
    poses: tuple[DesignPose, ...] = Field(min_length=1)
    levels_deg: dict[str, tuple[Number, ...]]
    levels_mm: dict[str, tuple[Number, ...]]
    predicted_std: tuple[PredictedStd, ...]
    targets: Annotated[str, From("problem.cell.targets_in_words")]
    survives: Survives
    candidates: CandidatesEntry
    joint_travel_deg: NotNegative
    joint_travel_mm: NotNegative
    reapproaches: ReapproachesEntry | None
    extends: Annotated[Count | None, From("problem.request.fixed")]
    against: dict[str, RivalPlan]
    curve: tuple[CurveStepEntry, ...]
    notes: tuple[str, ...]
    granted: tuple[str, ...]
    seconds: NotNegative
    seconds_by_part: Annotated[dict[str, NotNegative], From("seconds")]
    pays_until: Count | None
    matches: dict[str, Count | None]
    unchecked: str
    day: DayEntry | None

    @property
    def again(self) -> int:
        """Poses that are measured once more."""
        return 0 if self.reapproaches is None else len(self.reapproaches.again)

    @property
    def chosen(self) -> int:
        """Poses that differ from each other."""
        return len(self.poses) - self.again

    @property
    def level_joint(self) -> str | None:
        """The joint that stands at levels."""
        return next(iter({**self.levels_deg, **self.levels_mm}), None)


def design_record(found: Design, made_from: Envelope) -> DesignRecord:
    """The record of a design."""
    from doe.constraints.self_collision import unchecked
    from doe.curve import poses_that_match, stops_paying
    from doe.order import travel

    problem, judged = found.problem, found.assessment
    robot = problem.cell.robot
    units = [p.scale for p in problem.model.parameters]
    levels = shown_levels(found)
    counts, errors = [s.poses for s in found.curve], [s.task_rms for s in found.curve]
    return DesignRecord.from_result(
        found,
        judged,
        **made_from,
        warnings=(),
        proof=_proof(found),
        poses=_poses(found, levels),
        **_levels(found, levels),
        predicted_std=PredictedStd.from_each(problem.model.parameters, std=judged.std),
        survives=_survives(found),
        joint_travel_deg=math.degrees(travel(found.poses.q[:, ~robot.prismatic])),
        joint_travel_mm=_MM * travel(found.poses.q[:, robot.prismatic]),
        reapproaches=_reapproaches(found),
        against={
            name: RivalPlan.from_result(rival, rival.assessment, std=rival.assessment.std / units)
            for name, rival in found.rivals.items()
        },
        seconds=sum(found.seconds.values()),
        pays_until=stops_paying(counts, errors),
        matches=poses_that_match(found.curve, found) if found.curve else {},
        unchecked=unchecked(problem.cell),
        day=DayEntry.from_result(found.day),
    )


def _poses(found: Design, levels: list[float]) -> tuple[DesignPose, ...]:
    """The poses in their order."""
    robot, poses = found.problem.cell.robot, found.poses
    return tuple(
        DesignPose(pose=name, level=level, **shown_joints(robot, q))
        for name, level, q in zip(poses.names, levels, poses.q, strict=True)
    )


def shown_levels(found: Design) -> list[float]:
    """Level of each pose in degrees or mm, NaN without levels."""
    if found.levels is None:
        return [math.nan] * len(found.level)
    slides = bool(found.problem.cell.robot.prismatic[found.levels.joint])
    shown = found.level * _MM if slides else np.degrees(found.level)
    return [float(value) for value in np.round(shown, 6) + 0.0]


def _levels(found: Design, levels: list[float]) -> dict[str, dict[str, tuple[float, ...]]]:
    """The values of the joint that stands at levels, in the unit of its kind."""
    fields: dict[str, dict[str, tuple[float, ...]]] = {"levels_deg": {}, "levels_mm": {}}
    if found.levels is not None:
        robot, joint = found.problem.cell.robot, found.levels.joint
        unit = "levels_mm" if robot.prismatic[joint] else "levels_deg"
        fields[unit][robot.joints[joint]] = tuple(sorted(set(levels)))
    return fields


def _proof(found: Design) -> ProofEntry:
    proof, criterion = found.certificate, found.problem.criterion
    return ProofEntry.from_result(
        proof,
        weighted_value=criterion.shown(proof.weighted),
        before_polish=BeforePolish(
            value=criterion.shown(proof.pool_value),
            bound=criterion.shown(proof.pool_bound),
            efficiency=min(1.0, proof.pool_value / proof.pool_bound),
        ),
        surviving_candidates=found.candidates.survivors,
    )


def _survives(found: Design) -> Survives:
    judged, without = found.assessment, found.assessment.without_pose
    return Survives(
        loss_of_pose=LossOfPose(
            worst=found.poses.names[int(without.argmax())] if len(without) else None,
            task_rms_mm=without.max(initial=0.0) * _MM,
        ),
        loss_of_marker={name: rms * _MM for name, rms in judged.without_marker.items()},
    )


def _reapproaches(found: Design) -> ReapproachesEntry | None:
    own = found.reapproaches
    if own is None:
        return None
    return ReapproachesEntry.from_result(
        own, repeatability_relative_std=RelativeStd.from_result(own)
    )
