"""Compensation: commands with which the real arm stands where the nominal one should.

A target is a nominal command; wanted is the pose that the nominal robot, rigid and free of error, gives
its tip there. The command ``q + dq`` solves ``f(q + dq, w) = f_nominal(q)`` for the identified arm f at
rest under the load w of the target.

Poses are compared in the robot's base frame, as identified: where the instrument stands and how it errs
does not shift the arm. The constants that no marker shows are by convention in base and tool, so the
expected error is the distance, in the instrument's frame, of a tool point from its wanted place, as in
the criterion ``task``: at the markers, or at the tip's origin where ``tool`` is not in the model.
Where a target says no time of the session it comes after it: what warmed up is warm, what jumped stays
where it went, and a drift counts as none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.api import Plan, poses_of
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.targets import check_targets
from calib.diagnosis.diagnose import Diagnosis
from calib.effects.timed import Timed
from calib.effects.tool_base import Tool
from calib.errors import CalibError
from calib.identification.identification import Identification
from calib.model import Model
from calib.model.build import lacking
from calib.model.covariance import at_one_tip, read_frames, working_points
from calib.poses import Poses, hung
from calib.poses.moves import with_moves
from calib.prediction.commands import Goal, Reached, reach, tip_of
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of
from calib.prediction.trend import drift_words
from calib.result import Result
from calib.threads import one_blas_thread

Known: TypeAlias = Estimate | Identification | Diagnosis | str | Path

_NOTHING = 1e-7  # m or rad: what remains below this is rounding
_LARGE = np.radians(5.0)  # rad, or its share of the reach: no calibrated arm is off by as much
_MOST = 4  # names in a note
_RESTING = {
    "temperature": "the targets have no temperature: {} is left out (20 degC). Add temperature_degC",
    "time": "the targets have no time: {} is left out (first pose of the session). Add time_s",
    "torque": "the targets have no measured torques: {} is not corrected",
}
_AFTERWARDS = "the targets have no time in the session: {} counts as after it, warm and moved"


@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Result):
    """Result of :func:`compensate`, for m targets.

    targets : Poses, nominal commands with loads and approach; weights : ndarray, shape (m,)
    q : ndarray, shape (m, n), rad or m, corrected commands
    at : "markers" or "tip", the points at which errors count
    before : ndarray, shape (m,), m, by how much the identified arm misses at the nominal command
    left : ndarray, shape (m,), m, the same at the corrected command: zero where the arm can reach
    turn_before, turn_left : ndarray, shape (m,), rad, the same of the orientation
    error : ExpectedError at the corrected commands, beside what is left
    limited_by : tuple of str, why something is left at a target, "" where nothing is
    notes : tuple of str, what the user should know

    Distances are root mean squares over the points of a target, 3-D.
    """

    targets: Poses
    weights: Array
    q: Array
    at: str
    before: Array
    left: Array
    turn_before: Array
    turn_left: Array
    error: ExpectedError
    limited_by: tuple[str, ...]
    notes: tuple[str, ...]

    def sentences(self) -> list[str]:
        before, after = self.rms(self.before), self.rms(self.expected)
        return [
            f"Compensation: error at {len(self.q)} targets {1e3 * before:.3g} mm RMS before, "
            f"{1e3 * after:.3g} mm expected after",
            *self.notes,
        ]

    def rows(self) -> list[dict[str, object]]:
        before, after = (1e3 * self.before).tolist(), (1e3 * self.expected).tolist()
        each = zip(self.targets.names, before, after, self.limited_by, strict=True)
        columns = ("target", "before_mm", "expected_mm", "limited_by")
        return [dict(zip(columns, row, strict=True)) for row in each]

    @property
    def correction(self) -> Array:
        """Corrected minus nominal command, shape (m, n), rad or m."""
        return self.q - self.targets.q

    @property
    def expected(self) -> Array:
        """Error expected to remain at each target, shape (m,), m."""
        return np.asarray(np.hypot(self.left, self.error.rms))

    def rms(self, distances: Array) -> float:
        """Weighted root mean square over the targets, m."""
        return float(np.sqrt(self.weights @ distances**2 / self.weights.sum()))


@one_blas_thread
def compensate(
    cell: Cell,
    result: Known,
    targets: Plan,
    *,
    weights: Array | None = None,
    tip: str | None = None,
) -> Compensation:
    """Correct nominal joint commands by what was identified.

    result : Identification, Diagnosis, Estimate, or the file of a result
    targets : poses, the file of targets, or joint values (m, n); a file's or bare joints without a
        wrench carry the cell's [load]
    weights : ndarray, shape (m,), of the targets in the root mean squares; one by default, or the
        file's own
    tip : of several tips the one that is to be in place; ``robot.tip`` without

    Raises InputError, CalibError: an unusable file, a result of another robot or one that did not
    converge, targets outside the limits, a tip of which nothing is read, an arm without equilibrium.
    """
    estimate = _known(cell, result)
    if not estimate.converged:
        raise CalibError("the result did not converge; mend the identification first")
    poses, weights = _targets(cell, targets, weights)
    # The targets' own order is none of the session's.
    poses = replace(with_moves(poses), start=estimate.start, order=None)
    robot = replace(estimate.model.robot, limits=cell.robot.limits)
    frame = _tip_frame(estimate.model, tip)
    model, values = at_one_tip(replace(estimate.model, robot=robot), frame), estimate.values
    goal = _goal(model, values, poses, frame)
    found = reach(model, values, poses, goal)
    there = replace(poses, q=found.q)
    before, turn_before = goal.missed(tip_of(model, values, poses))
    left, turn_left = goal.missed(tip_of(model, values, there))
    error = ExpectedError(replace(estimate, model=model), there)
    moved_on = float(np.sqrt(weights @ error.trend**2 / weights.sum()))
    notes = (*estimate.notes, *_notes(estimate, poses, found.q), *_on_tips(cell, frame))
    return Compensation(
        targets=poses,
        weights=weights,
        q=found.q,
        at="markers" if len(model.where(Tool)) else "tip",
        before=before,
        left=left,
        turn_before=turn_before,
        turn_left=turn_left,
        error=error,
        limited_by=_reasons(robot, found, np.maximum(left, turn_left) > _NOTHING),
        notes=(*notes, *drift_words(moved_on, cell.design.targets_after)),
    )


def _known(cell: Cell, result: Known) -> Estimate:
    if isinstance(result, str | Path):
        from calib.files.estimate import load_estimate

        return load_estimate(cell, result)
    after = cell.design.targets_after or 0.0
    estimate = result if isinstance(result, Estimate) else estimate_of(result, after)
    if estimate.model.robot.joints != cell.robot.joints:
        raise CalibError(
            f"the result is of a robot with joints {', '.join(estimate.model.robot.joints)}, the "
            f"cell's has {', '.join(cell.robot.joints)}; give the result of this cell"
        )
    return estimate


def _targets(cell: Cell, targets: Plan, weights: Array | None) -> tuple[Poses, Array]:
    """Target poses with their loads, and weights. Raises CalibError where they are no targets."""
    if isinstance(targets, str | Path):
        from calib.files.tables import load_targets

        poses, given = load_targets(cell, targets)
    else:
        poses = poses_of(cell, targets)
        given = np.ones(len(poses))
        if isinstance(targets, np.ndarray) and cell.load is not None:
            poses = hung(poses, cell.load.mass, cell.load.com)
    weights = given if weights is None else np.asarray(weights, dtype=float)
    if not len(poses):
        raise CalibError("there are no targets")
    if not np.isfinite(poses.q).all():
        raise CalibError("the targets have joint values that are no numbers")
    if weights.shape != (len(poses),) or not (weights >= 0.0).all() or not weights.any():
        raise CalibError("weights must be one for each target, at least zero, and not all zero")
    check_targets(cell, poses)
    return poses, weights


def _tip_frame(model: Model, tip: str | None) -> int:
    """Frame of the tip that is to be in place. Raises CalibError where nothing is read on it."""
    robot, frames = model.robot, read_frames(model).tolist()
    read = [robot.tips[frame - robot.dof - 1] for frame in frames]
    if tip is None:
        tip = read[0] if len(read) == 1 else robot.tip
    if tip not in read:
        raise CalibError(f"nothing is read on {tip}; commands are corrected for {', '.join(read)}")
    return int(frames[read.index(tip)])


def _goal(model: Model, values: Array, poses: Poses, tip: int) -> Goal:
    """Where the nominal robot has the points that count; tip : frame that is to be in place."""
    nominal, working = forward(model.robot, poses.q), working_points(model)
    points = working.marker_positions(values)
    read = working.instruments[0].read_of(len(points))
    return Goal(nominal.R[:, tip], nominal.o[:, tip], points[read], tip)


def _reasons(robot: Robot, found: Reached, remains: Mask) -> tuple[str, ...]:
    """Why a target is not met in full, "" where it is."""
    reasons = [""] * len(remains)
    for i in np.flatnonzero(remains):
        stopped = [j for j, held in zip(robot.joints, found.held[i], strict=True) if held]
        causes = {
            f"limit of {', '.join(stopped)}": bool(stopped),
            "singular": found.lost[i],
            "fewer than six joints": robot.free.sum() < 6,
            "not settled": not found.settled[i],
        }
        reasons[i] = " and ".join(c for c, acts in causes.items() if acts) or "out of reach"
    return tuple(reasons)


def _notes(estimate: Estimate, poses: Poses, q: Array) -> Iterator[str]:
    """What was assumed of the targets, and what is odd about the corrections."""
    robot, effects = estimate.model.robot, estimate.model.effects
    if estimate.undetermined:
        yield (
            f"not identified, so nominal: {_shortened(estimate.undetermined)}. Their possible size "
            "counts as uncertainty"
        )
    missing = lacking(poses)
    if poses.clock_in(estimate.clock_unit) is None:
        missing |= {"time"}
    for covariate in sorted({name for e in effects for name in e.uses} & missing):
        for timed, text in ((False, _RESTING.get(covariate, "")), (True, _AFTERWARDS)):
            using = [e for e in effects if covariate in e.uses and isinstance(e, Timed) is timed]
            if text and using:
                yield text.format(_shortened([f"{e.kind}:{e.where}" for e in using]))
    sided = [e.where for e in effects if "approach" in e.uses]
    if sided and poses.approach_derived:
        joints = [robot.joints.index(j) for j in sided if j in robot.joints]
        yield from _on_approach(joints, poses, q)
    share = np.abs(q - poses.q) / np.where(robot.prismatic, robot.reach, 1.0)
    if share.max() > _LARGE:
        i, j = (int(k) for k in np.unravel_index(share.argmax(), share.shape))
        change = q[i, j] - poses.q[i, j]
        size = f"{change * 1e3:.1f} mm" if robot.prismatic[j] else f"{np.degrees(change):.1f} deg"
        yield (
            f"target {poses.names[i]} is corrected by {size} at {robot.joints[j]}, which is unusually "
            "large. It is near a singular pose, or cell and result do not belong together"
        )


def _on_approach(joints: list[int], poses: Poses, q: Array) -> Iterator[str]:
    """From which side some joints come, where nobody said it."""
    order = "of the table" if poses.time is None else "in time"
    yield (
        f"approach directions are derived from the order {order}. If there are moves between the "
        "targets, add columns approach_<joint>"
    )
    nominal, corrected = (with_moves(replace(poses, q=each)).approach for each in (poses.q, q))
    if nominal is None or corrected is None:
        return
    known = nominal[:, joints].all(axis=1)
    turned = known & (nominal != corrected)[:, joints].any(axis=1)
    unknown, turned_at = ([poses.names[i] for i in np.flatnonzero(at)] for at in (~known, turned))
    if unknown:
        yield f"approach unknown, and its effects not corrected, at {_shortened(unknown)}"
    if turned_at:
        yield (
            f"the corrections turn a small move round before {_shortened(turned_at)}: approach these "
            "from the side of the nominal commands"
        )


def _on_tips(cell: Cell, frame: int) -> Iterator[str]:
    """Which of several tips is in place, and what no instrument saw of it."""
    robot, unseen = cell.robot, cell.unseen_joints
    if unseen:
        yield f"no instrument saw an error of {', '.join(unseen)}: they count as nominal"
    if robot.branched:
        tip = robot.tips[frame - robot.dof - 1]
        yield f"commands are corrected for {tip}: other tips go with the joints that they share with it"


def _shortened(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more
