"""What ``posecal design`` finds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, Self, TypedDict

import numpy as np
from pydantic import Field, model_validator

from studies.joints import JointValues, check_same_joints, shown_joints
from studies.record import Count, Entry, Envelope, Maybe, MaybePositive, NotNegative, Number, Record
from studies.targets import TargetAccuracy, at_targets

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array
    from doe import Design
    from doe.assess import Assessment

_MM = 1e3
_CANDIDATES = 2000  # of the landscape that are kept; more only darken its cloud


class BeforePolish(Entry):
    """The plan of candidates alone."""

    value: Maybe
    bound: Maybe
    efficiency: Number


class Proof(Entry):
    """The certificate: what no plan surpasses, and how it was found."""

    weighted_value: Maybe
    solver_gap: Number
    before_polish: BeforePolish
    proved_optimal: bool
    nodes: Count
    fresh_bound: Maybe
    efficiency_fresh: Maybe
    agreement_of_starts: Number
    surviving_candidates: Count
    rounds: Count


class Pose(JointValues):
    """A pose of the plan; level : deg or mm, None without levels."""

    pose: str
    level: Maybe


class Predicted(Entry):
    """How well the plan determines a parameter."""

    name: str
    effect: str
    where: str
    id: str
    std: Maybe
    unit: str


class Accuracy(Entry):
    """What a plan is worth."""

    task_rms_mm: Maybe
    task_worst_mm: Maybe
    determinant: Maybe
    trace: Maybe
    observability: dict[str, Maybe]


class LossOfPose(Entry):
    """Without the pose that is worst to lose; efficiency : of what any plan could keep, at least."""

    worst: str | None
    task_rms_mm: Maybe
    criterion: Maybe
    efficiency: Maybe


class Survives(Entry):
    """What is left when something is lost; markers : task RMS without each, mm."""

    loss_of_pose: LossOfPose
    loss_of_marker: dict[str, Maybe]


class Candidates(Entry):
    """From how many poses the plan was chosen, and what removed the others."""

    drawn: Count
    feasible: Count
    removed_by: dict[str, Count]


class Reference(JointValues):
    """The pose that is repeated to see drift, and the names of its repeats."""

    pose: str
    poses: tuple[str, ...]
    every: Count


class RelativeStd(Entry):
    """Standard deviation of the arm's repeatability over its size, as second visits show it."""

    common: Maybe
    translation: Maybe
    rotation: Maybe


class Reapproaches(Entry):
    """Poses that are visited again, and the names of their second visits.

    task_rms_instead_mm : with as many new poses in their place; asked : else planned by default
    """

    poses: tuple[str, ...]
    again: tuple[str, ...]
    dof: NotNegative
    repeatability_relative_std: RelativeStd
    task_rms_instead_mm: Maybe = None
    asked: bool = True


class Rival(Accuracy):
    """A plan judged beside the result, by the same bound; std : of each parameter, in its unit."""

    poses: Count
    value: Maybe
    efficiency: Maybe
    std: tuple[Maybe, ...] = ()


class Step(Entry):
    """The best plan found of so many poses."""

    poses: int = Field(gt=0, lt=10**6)
    value: Maybe
    task_rms_mm: MaybePositive
    efficiency: Maybe


class Share(Entry):
    """What a pose tells of the parameters of each effect."""

    pose: str
    effects: dict[str, Number]


class Landscape(Entry):
    """Derivative of the criterion towards candidates, over the value of a joint.

    levels_rad : where the joint may stand; chosen : how many candidates, the first, are the plan's
    """

    joint: str
    levels_rad: tuple[Number, ...] | None
    value_rad: tuple[Number, ...]
    share: tuple[Number, ...]
    chosen: Count

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        if not self.chosen <= len(self.share) == len(self.value_rad):
            raise ValueError("value_rad, share and chosen do not fit together")
        return self


class DesignRecord(Record, Accuracy):
    """The poses to measure, and the proof of how good they are."""

    command: Literal["design"] = "design"
    criterion: str
    criterion_unit: str
    larger_is_better: bool
    value: Maybe
    bound: Maybe
    efficiency: Number
    proof: Proof
    poses: tuple[Pose, ...] = Field(min_length=1)
    levels_deg: dict[str, tuple[Number, ...]] = Field(default_factory=dict)
    levels_mm: dict[str, tuple[Number, ...]] = Field(default_factory=dict)
    predicted_std: tuple[Predicted, ...]
    targets: str
    at_targets: tuple[TargetAccuracy, ...]
    survives: Survives
    candidates: Candidates
    joint_travel_deg: NotNegative
    joint_travel_mm: NotNegative = 0.0
    reference: Reference | None
    reapproaches: Reapproaches | None
    extends: Count | None
    against: dict[str, Rival]
    curve: tuple[Step, ...]
    notes: tuple[str, ...]
    seconds: NotNegative
    seconds_by_part: dict[str, NotNegative]
    pays_until: Count | None = None
    matches: dict[str, Count | None] = Field(default_factory=dict)
    landscape: Landscape | None = None
    by_pose: tuple[Share, ...] = ()
    unchecked: str = ""

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        check_same_joints(self.poses)
        if any(len(own.std) not in (0, len(self.predicted_std)) for own in self.against.values()):
            raise ValueError("against has other parameters")
        if len({tuple(share.effects) for share in self.by_pose}) > 1:
            raise ValueError("by_pose has other effects from pose to pose")
        if not set(self.matches) <= set(self.against):
            raise ValueError("matches names a plan that against lacks")
        if self.again > len(self.poses):
            raise ValueError("reference and reapproaches count more poses than there are")
        return self

    @property
    def again(self) -> int:
        """Poses that are measured once more: repeats of the reference, and second visits."""
        repeats = 0 if self.reference is None else len(self.reference.poses)
        return repeats + (0 if self.reapproaches is None else len(self.reapproaches.again))

    @property
    def chosen(self) -> int:
        """Poses that differ from each other."""
        return len(self.poses) - self.again

    @property
    def proved(self) -> int:
        """Stops that the proof speaks of: all but repeats of the reference."""
        return self.chosen + (0 if self.reapproaches is None else len(self.reapproaches.again))

    @property
    def level_joint(self) -> str | None:
        """The joint that stands at levels."""
        return next(iter({**self.levels_deg, **self.levels_mm}), None)


def design_record(found: Design, made_from: Envelope) -> DesignRecord:
    """The record of a design."""
    from doe.constraints.unchecked import unchecked
    from doe.curve import poses_that_match, stops_paying
    from doe.visits.order import travel

    problem, judged = found.problem, found.assessment
    robot, criterion = problem.cell.robot, problem.criterion
    levels = shown_levels(found)
    slides = found.levels is not None and bool(robot.prismatic[found.levels.joint])
    named = {} if found.levels is None else {
        robot.joints[found.levels.joint]: tuple(sorted(set(levels)))
    }  # fmt: skip
    counts, errors = [s.poses for s in found.curve], [s.task_rms for s in found.curve]
    return DesignRecord(
        **made_from,
        **_accuracy(judged),
        criterion=criterion.name,
        criterion_unit=criterion.unit,
        larger_is_better=criterion.larger_is_better,
        value=found.value,
        bound=found.bound,
        efficiency=found.efficiency,
        proof=_proof(found),
        poses=_poses(found, levels),
        levels_deg={} if slides else named,
        levels_mm=named if slides else {},
        predicted_std=_predicted(found),
        targets=problem.cell.targets_in_words,
        at_targets=at_targets(robot, problem.targets, judged.at_targets),
        survives=_survives(found),
        candidates=_candidates(found),
        joint_travel_deg=math.degrees(travel(found.poses.q[:, ~robot.prismatic])),
        joint_travel_mm=_MM * travel(found.poses.q[:, robot.prismatic]),
        reference=_reference(found),
        reapproaches=_reapproaches(found),
        extends=None if problem.request.fixed is None else len(problem.request.fixed),
        against={name: _rival(found, name) for name in found.rivals},
        curve=_curve(found),
        notes=found.notes,
        seconds=sum(found.seconds.values()),
        seconds_by_part=found.seconds,
        pays_until=stops_paying(counts, errors),
        matches=poses_that_match(found.curve, found) if found.curve else {},
        landscape=_landscape(found),
        by_pose=_by_pose(found),
        unchecked=unchecked(problem.cell),
    )


def _poses(found: Design, levels: Sequence[float]) -> tuple[Pose, ...]:
    robot, poses = found.problem.cell.robot, found.poses
    return tuple(
        Pose(pose=name, level=level, **_joints(robot, q))
        for name, q, level in zip(poses.names, poses.q, levels, strict=True)
    )


def _predicted(found: Design) -> tuple[Predicted, ...]:
    std: list[float] = found.assessment.std.tolist()
    return tuple(
        Predicted(
            name=p.name, effect=p.effect, where=p.where, id=p.id, std=own / p.scale, unit=p.unit
        )
        for p, own in zip(found.problem.model.parameters, std, strict=True)
    )


def _candidates(found: Design) -> Candidates:
    own = found.candidates
    return Candidates(drawn=own.drawn, feasible=own.feasible, removed_by=own.removed_by)


def _curve(found: Design) -> tuple[Step, ...]:
    return tuple(
        Step(
            poses=step.poses,
            value=step.value,
            task_rms_mm=step.task_rms * _MM,
            efficiency=step.efficiency,
        )
        for step in found.curve
    )


def shown_levels(found: Design) -> list[float]:
    """Level of each pose in degrees or mm, NaN without levels."""
    if found.levels is None:
        return [math.nan] * len(found.level)
    slides = bool(found.problem.cell.robot.prismatic[found.levels.joint])
    shown = found.level * _MM if slides else np.degrees(found.level)
    return [float(value) for value in np.round(shown, 6) + 0.0]


def _joints(robot: Robot, q: Array) -> dict[str, dict[str, float]]:
    shown = shown_joints(robot, q)
    return {"joints_deg": shown.deg, "joints_mm": shown.mm}


class _Worth(TypedDict):
    """Fields of an accuracy."""

    task_rms_mm: float
    task_worst_mm: float
    determinant: float
    trace: float
    observability: dict[str, float | None]


def _accuracy(judged: Assessment) -> _Worth:
    return _Worth(
        task_rms_mm=judged.task_rms * _MM,
        task_worst_mm=judged.task_worst * _MM,
        determinant=judged.determinant,
        trace=judged.trace,
        observability=dict(judged.observability),
    )


def _proof(found: Design) -> Proof:
    proof, criterion = found.certificate, found.problem.criterion
    fresh = not math.isnan(proof.fresh)
    return Proof(
        weighted_value=criterion.shown(proof.weighted),
        solver_gap=proof.solver_share,
        before_polish=BeforePolish(
            value=criterion.shown(proof.pool_value),
            bound=criterion.shown(proof.pool_bound),
            efficiency=min(1.0, proof.pool_value / proof.pool_bound),
        ),
        proved_optimal=proof.optimal,
        nodes=proof.nodes,
        fresh_bound=criterion.shown(proof.fresh) if fresh else None,
        efficiency_fresh=min(1.0, proof.value / proof.fresh) if fresh else None,
        agreement_of_starts=proof.agreement,
        surviving_candidates=found.candidates.survivors,
        rounds=proof.rounds,
    )


def _survives(found: Design) -> Survives:
    judged, proof, request = found.assessment, found.certificate, found.problem.request
    without = judged.without_pose
    alone = request.fixed is None and not found.problem.model.prior_rows
    return Survives(
        loss_of_pose=LossOfPose(
            worst=found.poses.names[int(without.argmax())] if len(without) else None,
            task_rms_mm=without.max(initial=0.0) * _MM,
            criterion=found.problem.criterion.shown(proof.left) if proof.left > 0.0 else None,
            efficiency=proof.kept(request.poses + len(_again(found)), alone),
        ),
        loss_of_marker={name: rms * _MM for name, rms in judged.without_marker.items()},
    )


def _reference(found: Design) -> Reference | None:
    own = found.reference
    if own is None:
        return None
    q = found.poses.q[found.poses.names.index(own.pose)]
    joints = _joints(found.problem.cell.robot, q)
    return Reference(pose=own.pose, poses=tuple(own.repeats), every=own.every, **joints)


def _reapproaches(found: Design) -> Reapproaches | None:
    own = found.reapproaches
    if own is None:
        return None
    return Reapproaches(
        poses=tuple(own.poses),
        again=tuple(own.again),
        dof=own.dof,
        repeatability_relative_std=RelativeStd(
            common=own.common, translation=own.translation, rotation=own.rotation
        ),
        task_rms_instead_mm=own.instead * _MM,
        asked=own.asked,
    )


def _again(found: Design) -> tuple[str, ...]:
    return () if found.reapproaches is None else found.reapproaches.again


def _rival(found: Design, name: str) -> Rival:
    rival = found.rivals[name]
    scales = np.array([p.scale for p in found.problem.model.parameters])
    return Rival(
        **_accuracy(rival.assessment),
        poses=rival.poses,
        value=rival.assessment.value,
        efficiency=rival.efficiency,
        std=tuple((rival.assessment.std / scales).tolist()),
    )


def _landscape(found: Design) -> Landscape:
    """The plan's own poses and the best of the others."""
    robot, view = found.problem.cell.robot, found.landscape
    joint = found.levels.joint if found.levels is not None else min(1, robot.dof - 1)
    order = np.argsort(~view.chosen, kind="stable")[:_CANDIDATES]
    return Landscape(
        joint=robot.joints[joint],
        levels_rad=None if found.levels is None else tuple(found.levels.values.tolist()),
        value_rad=tuple(view.q[order, joint].round(6).tolist()),
        share=tuple(view.share[order].round(6).tolist()),
        chosen=int(view.chosen.sum()),
    )


def _by_pose(found: Design) -> tuple[Share, ...]:
    from studies.compare.anatomy import influence_by_effect
    from studies.compare.experiment import POINTS, experiment_of
    from studies.compare.prediction import predict

    experiment = experiment_of(found.problem.cell, found.poses)
    prediction = predict(experiment, POINTS)
    shares, effects = influence_by_effect(experiment, prediction, len(found.poses))
    return tuple(
        Share(pose=name, effects=dict(zip(effects, own.tolist(), strict=True)))
        for name, own in zip(found.poses.names, shares, strict=True)
    )
