"""Compensation: joint commands with which the real arm stands where the nominal one should.

A target is a nominal joint command; what is wanted is the pose that the nominal robot, rigid and free
of error, gives its tip there. The identified arm is bent by the load of the target itself, so the
command ``q + dq`` solves ``f(q + dq, w) = f_nominal(q)`` with the equilibrium in it
(:mod:`calib.predict.commands`).

Frames. Wanted and reached poses are compared in the robot base frame, as identified: where the
instrument stands and how it errs does not shift the arm. The constants that no marker shows (where the
first joint's zero is beside a free base, where the flange is beside free markers) are by convention in
base and tool, so "the base frame" is the one that the result places in the instrument's frame, and
accuracy can be checked only at the points that were measured. The error expected to remain is
therefore the distance, in the instrument's frame, between a tool point and its wanted place, as in the
criterion ``task``: at the markers, or at the tip's origin where ``tool`` is not in the model. Base and
tool count with all their correlations to the rest. Motions of the base with its load or in time are
the arm's own and are corrected. Where a target says no time of the session it comes after it: what
warmed up is warm, what jumped stays where it went, and a drift in the model, of which nobody knows how
it went on, counts as none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.api import Plan, poses_of
from calib.arm.kinematics import forward
from calib.arm.se3 import rotate, so3_log
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.targets import check_targets
from calib.diagnosis.diagnose import Diagnosis
from calib.effects.readings import ReadingEffect
from calib.effects.timed import Timed
from calib.effects.tool import Tool
from calib.errors import CalibError
from calib.identification.identification import Identification
from calib.model import Model
from calib.model.build import lacking
from calib.model.covariance import at_one_tip, errors_at, read_frames, working_points
from calib.poses import Poses, hung
from calib.poses.moves import moves, with_moves
from calib.predict.commands import Goal, Reached, reach, tip_of
from calib.predict.discrepancy import Unexplained, scatter_at
from calib.predict.estimate import Estimate, estimate_of
from calib.result import Result
from calib.scatter.owner import Owner
from calib.threads import one_blas_thread

Known: TypeAlias = Estimate | Identification | Diagnosis | str | Path

_BLOCK = 2000  # targets at a time: memory stays bounded
_NOTHING = 1e-7  # m or rad: what remains below this is rounding
_LARGE = np.radians(5.0)  # rad, or its share of the reach: no calibrated arm is off by as much
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
    spread : ndarray, shape (m,), m, standard error that the parameters' uncertainty leaves
    scatter : ndarray, shape (m,), m, by how much the arm errs anew at each target, as far as the data
        or the cell say it; what they do not tell from what the model lacks counts here
    unfollowed : ndarray, shape (m,), m, what the model does not follow from pose to pose
    unexplained : Unexplained, what the model leaves at any pose beside all that
    rest_of : whose what differs from configuration to configuration is
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
    spread: Array
    scatter: Array
    unfollowed: Array
    unexplained: Unexplained
    rest_of: Owner
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
        return [
            {
                "target": name,
                "before_mm": 1e3 * before,
                "expected_mm": 1e3 * after,
                "limited_by": why,
            }
            for name, before, after, why in zip(
                self.targets.names,
                self.before.tolist(),
                self.expected.tolist(),
                self.limited_by,
                strict=True,
            )
        ]

    @property
    def correction(self) -> Array:
        """Corrected minus nominal command, shape (m, n), rad or m."""
        return self.q - self.targets.q

    @property
    def expected(self) -> Array:
        """Error expected to remain at each target, shape (m,), m."""
        known = self.left**2 + self.spread**2 + self.scatter**2
        return np.asarray(np.sqrt(known + self.lacking**2))

    @property
    def lacking(self) -> Array:
        """What the model does not explain at each target, shape (m,), m."""
        return np.hypot(self.unfollowed, self.unexplained.rms)

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
    tip : of several tips the one that is to be in place; ``robot.tip`` without. The others go with the
        joints that they share with it

    Raises InputError, CalibError: an unusable file, a result of another robot or one that did not
    converge, targets outside the limits, a tip of which nothing is read, an arm without equilibrium.
    """
    estimate = _known(cell, result)
    if not estimate.converged:
        raise CalibError("the result did not converge; mend the identification first")
    poses, given = _targets(cell, targets)
    weights = given if weights is None else np.asarray(weights, dtype=float)
    _check(cell, poses, weights)
    # The targets' own order is none of the session's.
    poses = replace(with_moves(poses), start=estimate.start, order=None)
    model = replace(estimate.model, robot=replace(estimate.model.robot, limits=cell.robot.limits))
    frame = _tip_frame(model, tip)
    model = at_one_tip(model, frame)
    blocks = np.array_split(np.arange(len(poses)), -(-len(poses) // _BLOCK))
    known = replace(estimate, model=model)
    parts = [_block(known, poses.take(block), frame) for block in blocks]
    by_target = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    limited_by, q = tuple(by_target.pop("limited_by").tolist()), by_target["q"]
    return Compensation(
        targets=poses,
        weights=weights,
        at="markers" if len(model.where(Tool)) else "tip",
        **by_target,
        unexplained=estimate.unexplained,
        rest_of=estimate.rest_of,
        limited_by=limited_by,
        notes=(*estimate.notes, *_notes(estimate, poses, q), *_on_tips(cell, frame)),
    )


def _known(cell: Cell, result: Known) -> Estimate:
    if isinstance(result, str | Path):
        from calib.files.estimate import load_estimate

        return load_estimate(cell, result)
    estimate = result if isinstance(result, Estimate) else estimate_of(result)
    if estimate.model.robot.joints != cell.robot.joints:
        raise CalibError(
            f"the result is of a robot with joints {', '.join(estimate.model.robot.joints)}, the "
            f"cell's has {', '.join(cell.robot.joints)}; give the result of this cell"
        )
    return estimate


def _targets(cell: Cell, targets: Plan) -> tuple[Poses, Array]:
    if isinstance(targets, str | Path):
        from calib.files.tables import load_targets

        return load_targets(cell, targets)
    poses = poses_of(cell, targets)
    if isinstance(targets, np.ndarray) and cell.load is not None:
        poses = hung(poses, cell.load.mass, cell.load.com)
    return poses, np.ones(len(poses))


def _check(cell: Cell, poses: Poses, weights: Array) -> None:
    if not len(poses):
        raise CalibError("there are no targets")
    if not np.isfinite(poses.q).all():
        raise CalibError("the targets have joint values that are no numbers")
    if weights.shape != (len(poses),) or not (weights >= 0.0).all() or not weights.any():
        raise CalibError("weights must be one for each target, at least zero, and not all zero")
    check_targets(cell, poses)


def _tip_frame(model: Model, tip: str | None) -> int:
    """Frame of the tip that is to be in place. Raises CalibError where nothing is read on it."""
    robot, frames = model.robot, read_frames(model).tolist()
    read = [robot.tips[frame - robot.dof - 1] for frame in frames]
    if tip is None:
        tip = read[0] if len(read) == 1 else robot.tip
    if tip not in read:
        raise CalibError(f"nothing is read on {tip}; commands are corrected for {', '.join(read)}")
    return int(frames[read.index(tip)])


def _on_tips(cell: Cell, frame: int) -> Iterable[str]:
    """Of a robot with several tips, which one is in place, and what no instrument saw of it."""
    robot, unseen = cell.robot, cell.unseen_joints
    if unseen:
        yield f"no instrument saw an error of {', '.join(unseen)}: they count as nominal"
    if robot.branched:
        tip = robot.tips[frame - robot.dof - 1]
        yield f"commands are corrected for {tip}: other tips go with the joints that they share with it"


def _block(estimate: Estimate, poses: Poses, tip: int) -> dict[str, Array]:
    """Fields of :class:`Compensation` that have one entry for each target, for some of them.

    tip : frame of the tip that is to be in place
    """
    model, values = estimate.model, estimate.values
    working = working_points(model)
    points = working.marker_positions(values)
    points = points[working.instruments[0].read_of(len(points))]
    nominal, now = forward(model.robot, poses.q), tip_of(model, values, poses)
    R, o = nominal.R[:, tip], nominal.o[:, tip]
    found = reach(model, values, poses, Goal(R, o, points, tip))
    before, turn_before = _distance(R, o, now.R[:, tip], now.o[:, tip], points)
    left, turn_left = _distance(R, o, found.R, found.o, points)
    there = replace(poses, q=found.q)
    scatter, unfollowed = (
        np.sqrt(scatter_at(model, values, there, own).mean(axis=-1))
        for own in (estimate.arm, estimate.unfollowed)
    )
    reasons = _reasons(model, found, (left > _NOTHING) | (turn_left > _NOTHING))
    return {
        "q": found.q,
        "before": before,
        "left": left,
        "turn_before": turn_before,
        "turn_left": turn_left,
        "spread": _spread(estimate, there),
        "scatter": scatter,
        "unfollowed": unfollowed,
        "limited_by": np.array(reasons),
    }


def _distance(R: Array, o: Array, R_is: Array, o_is: Array, points: Array) -> tuple[Array, Array]:
    """RMS distance [m] of the points (k, 3) of the tip frame, and angle [rad], both (m,)."""
    apart = rotate((R_is - R)[:, None], points) + (o_is - o)[:, None]
    turn = so3_log(R_is @ np.swapaxes(R, -1, -2))
    square = (apart**2).sum(axis=-1).mean(axis=-1)
    return np.sqrt(square), np.linalg.norm(turn, axis=-1)


def _spread(estimate: Estimate, poses: Poses) -> Array:
    """Standard error (m,), m, of where the tool points are; how the instrument errs is no part."""
    model = estimate.model
    own = np.setdiff1d(np.arange(len(model.parameters)), model.where(ReadingEffect))
    arm = model.with_effects(tuple(e for e in model.effects if not isinstance(e, ReadingEffect)))
    cov = estimate.covariance[np.ix_(own, own)]
    return errors_at(arm, estimate.values[own], cov, poses)


def _reasons(
    model: Model, found: Reached, remains: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> list[str]:
    """Why a target is not met in full, "" where it is."""
    robot = model.robot
    reasons = [""] * len(remains)
    for i in np.flatnonzero(remains):
        stopped = [j for j, held in zip(robot.joints, found.held[i], strict=True) if held]
        causes = [f"limit of {', '.join(stopped)}"] if stopped else []
        if found.lost[i]:
            causes.append("singular")
        if robot.free.sum() < 6:
            causes.append("fewer than six joints")
        if not found.settled[i]:
            causes.append("not settled")
        reasons[i] = " and ".join(causes) or "out of reach"
    return reasons


def _notes(estimate: Estimate, poses: Poses, q: Array) -> Iterable[str]:
    """What was assumed of the targets, and what is odd about the corrections."""
    model = estimate.model
    if estimate.undetermined:
        yield (
            f"not identified, so nominal: {_shortened(estimate.undetermined)}. Their possible size "
            "counts as uncertainty"
        )
    missing = lacking(poses)
    if poses.clock_in(estimate.clock_unit) is None:
        missing |= {"time"}
    for covariate in sorted({name for e in model.effects for name in e.uses} & missing):
        using = [e for e in model.effects if covariate in e.uses]
        over = [e for e in using if isinstance(e, Timed)]
        resting = [e for e in using if e not in over]
        for text, effects in ((_RESTING.get(covariate, ""), resting), (_AFTERWARDS, over)):
            if text and effects:
                yield text.format(_shortened(f"{e.kind}:{e.where}" for e in effects))
    if any("approach" in e.uses for e in model.effects) and poses.approach_derived:
        yield from _on_approach(model, poses, q)
    share = np.abs(q - poses.q) / np.where(model.robot.prismatic, model.robot.reach, 1.0)
    if share.max() > _LARGE:
        i, j = (int(k) for k in np.unravel_index(share.argmax(), share.shape))
        yield (
            f"target {poses.names[i]} is corrected by {_shown(model, j, q[i, j] - poses.q[i, j])} at "
            f"{model.robot.joints[j]}, which is unusually large. It is near a singular pose, or "
            "cell and result do not belong together"
        )


def _on_approach(model: Model, poses: Poses, q: Array) -> Iterable[str]:
    order = "of the table" if poses.time is None else "in time"
    yield (
        f"approach directions are derived from the order {order}. If there are moves between the "
        "targets, add columns approach_<joint>"
    )
    joints = [e.where for e in model.effects if "approach" in e.uses]
    own = [model.robot.joints.index(j) for j in joints if j in model.robot.joints]
    approach = poses.approach
    if approach is None:
        return
    unknown = ~approach[:, own].all(axis=1)
    if unknown.any():
        names = [poses.names[i] for i in np.flatnonzero(unknown)]
        yield f"approach unknown, and its effects not corrected, at {_shortened(names)}"
    order_of: IntArray = (
        np.arange(len(q)) if poses.time is None else np.argsort(poses.time, kind="stable")
    )
    turned = np.zeros(len(q), dtype=bool)
    turned[order_of] = (moves(q[order_of])[0] != approach[order_of])[:, own].any(axis=1)
    if (turned & ~unknown).any():
        names = [poses.names[i] for i in np.flatnonzero(turned & ~unknown)]
        yield (
            f"the corrections turn a small move round before {_shortened(names)}: approach these from "
            "the side of the nominal commands"
        )


def _shown(model: Model, joint: int, change: float) -> str:
    slides = model.robot.prismatic[joint]
    return f"{change * 1e3:.1f} mm" if slides else f"{np.degrees(change):.1f} deg"


def _shortened(names: Iterable[str], most: int = 4) -> str:
    every = list(names)
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return ", ".join(every[:most]) + more
