"""The JSON of ``posecal design``: poses to measure or motions to log, and how good they are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field

from calib import Cell
from calib.arm.robot import Robot
from studies.results.base import (
    MM,
    Cause,
    Count,
    Entry,
    Envelope,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Result,
)
from studies.results.expected import ExpectedErrors
from studies.results.parts import JointValues, ParameterStd, joint_values

if TYPE_CHECKING:  # what reads results needs no designs
    from doe import Design
    from doe.motions import MotionDesign
    from doe.motions.draw import Motion


class DesignPose(JointValues):
    """A pose of the plan; level : deg or mm, None without levels."""

    pose: str
    level: Maybe


class PlanAccuracy(Entry):
    """What a plan is worth."""

    task_rms_mm: Maybe
    task_worst_mm: Maybe
    determinant: Maybe
    trace: Maybe


class CandidateCounts(Entry):
    """From how many poses the plan was chosen, and what removed the others."""

    drawn: Count
    feasible: Count
    removed_by: dict[str, Count]


class RepeatVisits(Entry):
    """Poses that are visited again, the names of their second visits, and what these free."""

    poses: tuple[str, ...]
    again: tuple[str, ...]
    dof: NotNegative


class RivalPlan(PlanAccuracy):
    """A plan judged by the same bound."""

    poses: Count
    value: Maybe
    efficiency: Maybe


class CurveStep(Entry):
    """The best plan found of so many poses."""

    poses: int = Field(gt=0, lt=10**6)
    value: Maybe
    task_rms_mm: MaybePositive
    efficiency: Maybe


class DesignResult(Result, PlanAccuracy):
    """The poses to measure, and the proof of how good they are.

    expected : error at the targets, if the model is complete and the arm scatters as the cell states
    """

    command: Literal["design"] = "design"
    criterion: str
    criterion_unit: str
    larger_is_better: bool
    value: Maybe
    bound: Maybe
    efficiency: Number
    poses: tuple[DesignPose, ...] = Field(min_length=1)
    levels_deg: dict[str, tuple[Number, ...]]
    levels_mm: dict[str, tuple[Number, ...]]
    predicted_std: tuple[ParameterStd, ...]
    expected: ExpectedErrors
    targets: str
    candidates: CandidateCounts
    joint_travel_deg: NotNegative
    joint_travel_mm: NotNegative
    reapproaches: RepeatVisits | None
    extends: Count | None
    against: dict[str, RivalPlan]
    curve: tuple[CurveStep, ...]
    notes: tuple[str, ...]
    granted: tuple[str, ...]
    seconds: NotNegative
    unchecked: str
    duration_s: Maybe

    @classmethod
    def of(cls, found: Design, cell: Cell, made_from: Envelope) -> Self:
        """A design in a cell."""
        from doe.constraints.self_collision import unchecked
        from doe.order import travel

        problem, judged, again = found.problem, found.assessment, found.reapproaches
        criterion, fixed, robot = problem.criterion, problem.request.fixed, cell.robot
        levels = shown_levels(found)
        return cls.from_object(
            judged,
            **made_from,
            **_levels(found, levels),
            criterion=found.criterion,
            criterion_unit=criterion.unit,
            larger_is_better=criterion.larger_is_better,
            value=found.value,
            bound=found.bound,
            efficiency=found.efficiency,
            poses=tuple(
                DesignPose(pose=name, level=level, **joint_values(robot, q))
                for name, level, q in zip(found.poses.names, levels, found.poses.q, strict=True)
            ),
            predicted_std=ParameterStd.known(problem.model.parameters, judged.std),
            expected=ExpectedErrors.of_plan(found, cell),
            targets=cell.targets_in_words,
            candidates=CandidateCounts.from_object(problem.pool),
            joint_travel_deg=math.degrees(travel(found.poses.q[:, ~robot.prismatic])),
            joint_travel_mm=travel(found.poses.q[:, robot.prismatic]) * MM,
            reapproaches=None if again is None else RepeatVisits.from_object(again),
            extends=None if fixed is None else len(fixed),
            against={
                name: RivalPlan.from_object(
                    own.assessment, poses=own.poses, efficiency=own.efficiency
                )
                for name, own in found.rivals.items()
            },
            curve=tuple(map(CurveStep.from_object, found.curve)),
            notes=found.notes,
            granted=found.granted,
            seconds=found.seconds,
            unchecked=unchecked(cell),
            duration_s=found.duration,
        )

    @property
    def main_table(self) -> tuple[DesignPose, ...]:
        return self.poses

    @property
    def chosen(self) -> int:
        """Poses that differ from each other."""
        return len(self.poses) - (0 if self.reapproaches is None else len(self.reapproaches.again))


def shown_levels(found: Design) -> list[float]:
    """Level of each pose in degrees or mm, NaN without levels."""
    if found.levels is None:
        return [math.nan] * len(found.level)
    slides = bool(found.problem.cell.robot.prismatic[found.levels.joint])
    shown = found.level * MM if slides else np.degrees(found.level)
    return [float(value) for value in np.round(shown, 6) + 0.0]


def _levels(found: Design, levels: list[float]) -> dict[str, Any]:
    """The values of the joint that stands at levels, in the unit of its kind."""
    fields: dict[str, dict[str, tuple[float, ...]]] = {"levels_deg": {}, "levels_mm": {}}
    if found.levels is not None:
        robot, joint = found.problem.cell.robot, found.levels.joint
        unit = "levels_mm" if robot.prismatic[joint] else "levels_deg"
        fields[unit][robot.joints[joint]] = tuple(sorted(set(levels)))
    return fields


# -- motions -----------------------------------------------------------------------------------


def name_of(index: int) -> str:
    """Name of the session of a motion; index : from zero."""
    return f"motion{index + 1}"


class PlannedMotion(Entry):
    """A motion to log; largest : speed of the fastest joint, and which joint that is."""

    session: str
    seconds: Positive
    payload_kg: NotNegative
    fastest: str
    largest: NotNegative
    unit: Literal["deg/s", "mm/s"]

    @classmethod
    def of(cls, session: str, motion: Motion, robot: Robot) -> Self:
        """The entry of a motion."""
        speed = np.abs(motion.at(motion.time)[1]).max(axis=0)
        first = int(speed.argmax())
        slides, most = bool(robot.prismatic[first]), float(speed[first])
        return cls(
            session=session,
            seconds=motion.lasts,
            payload_kg=motion.payload.mass,
            fastest=robot.joints[first],
            largest=most * MM if slides else math.degrees(most),
            unit="mm/s" if slides else "deg/s",
        )


class PredictedTerm(Cause):
    """A parameter of the torque and the deviation that it will have."""

    name: str
    std: Maybe
    unit: str


class MotionDesignResult(Result):
    """The motions to log.

    motions : by which it is known from a design of poses
    value, bound : of the criterion, parameters in plausible sizes: a tenth of the torque, of a mass
    random : share of the bound that motions drawn by chance reach, median of a hundred choices
    open : inertials for which others of the model stand in every motion
    """

    command: Literal["design"] = "design"
    motions: Literal[True] = True
    criterion: str
    larger_is_better: bool
    value: Number
    bound: Number
    efficiency: Number
    random: Number
    chosen: tuple[PlannedMotion, ...]
    predicted_std: tuple[PredictedTerm, ...]
    open: tuple[str, ...]
    candidates: Count
    removed_by: dict[str, int]
    granted: tuple[str, ...]
    seconds: NotNegative

    @classmethod
    def of(cls, found: MotionDesign, made_from: Envelope) -> Self:
        """A design in its cell."""
        pairs = zip(found.parameters, found.std.tolist(), strict=True)
        return cls.from_object(
            found,
            **made_from,
            motions=True,
            criterion=found.criterion.name,
            larger_is_better=found.criterion.larger_is_better,
            chosen=tuple(
                PlannedMotion.of(name_of(k), own, found.cell.robot)
                for k, own in enumerate(found.motions)
            ),
            predicted_std=tuple(PredictedTerm.from_object(p, std=std) for p, std in pairs),
            removed_by=found.removed,
        )

    @property
    def main_table(self) -> tuple[PlannedMotion, ...]:
        return self.chosen
