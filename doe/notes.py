"""What a reader should know about a plan, one rule a note."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arm.robot import odd_limits
from calib.effects.protocol import ElasticEffect
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from doe.constraints import Floor
from doe.constraints.self_collision import SelfCollision
from doe.plan import Design
from doe.problem.determined import told


def notes_of(design: Design) -> tuple[str, ...]:
    """What a reader should know about a plan."""
    return tuple(note for rule in _NOTES for note in rule(design))


def _weak(design: Design) -> Iterator[str]:
    std, sizes = design.assessment.std, design.problem.model.sizes
    parameters = design.problem.model.parameters
    weak = [p.id for p, s, size in zip(parameters, std, sizes, strict=True) if not s <= size]
    if weak:
        yield (
            f"this plan hardly determines {', '.join(weak[:6])}{' ..' * (len(weak) > 6)}. Do not "
            f"identify them from it, or plan with criterion A or D in place of {design.criterion}"
        )


def _left_out(design: Design) -> Iterator[str]:
    lost = design.problem.left_out
    if lost:
        yield f"not planned for, as the arm's own weight does not show it: {told(lost)}"


def _unplanned(design: Design) -> Iterator[str]:
    left = design.problem.unplanned
    if left:
        yield (
            f"not planned for, as a plan chooses no order, sides and times: {', '.join(left)}. "
            "posecal diagnose --plan-only says what a plan shows of such causes"
        )


def _common(design: Design) -> Iterator[str]:
    """That the criterion is without what all readings err by together."""
    common, rms = design.assessment.common, design.assessment.task_rms
    if common > 0.0:
        yield (
            f"errors common to all readings ([instrument.common]) cause {common * 1e3:.2g} mm of the "
            f"{rms * 1e3:.2g} mm expected at the targets. More poses do not lower them. The standard "
            "deviations include them, the criterion and its certificate do not"
        )


def _unseen(design: Design) -> Iterator[str]:
    """That instruments on links do not see what carries them with what they read."""
    joints = design.problem.cell.unseen_joints
    if joints:
        yield (
            f"no instrument sees an error of {', '.join(joints)}, which carry what reads and what is "
            "read alike. The expected error at the targets is without them"
        )
    model = design.problem.model
    if joints and model.robot.masses.any() and len(model.where(ElasticEffect)):
        yield (
            f"if {', '.join(joints)} yield, gravity tilts for the arm as well, and its deflections "
            "differ from those that the plan foresees. An instrument that does not ride on the robot "
            "shows it"
        )


def _outside(design: Design) -> Iterator[str]:
    """Plans that were given, with poses beyond the limits."""
    low, high = design.problem.cell.robot.limits.T
    given = {name: rival.q for name, rival in design.rivals.items()}
    if design.problem.request.fixed is not None:
        given["the plan to extend"] = design.problem.request.fixed.q
    for name, q in given.items():
        count = int(((q < low - 1e-4) | (q > high + 1e-4)).any(axis=1).sum())
        if count:
            yield f"{name}: {count} poses are outside the joint limits"


def _unmoved(design: Design) -> Iterator[str]:
    """E can be bounded by a direction that is the same at every pose: poses by chance do as well."""
    problem = design.problem
    # The mean information of the pool is the identity.
    by_chance = problem.fixed + problem.request.poses * np.eye(len(problem.fixed))
    alike = problem.criterion.value(by_chance) > 0.999 * design.certificate.value
    if design.criterion == "E" and alike:
        yield (
            "criterion E depends on a combination that is the same for all poses, such as a shift "
            "of the base. Say which parameters matter (--of)"
        )


def _no_targets(design: Design) -> Iterator[str]:
    if design.problem.cell.design.targets is None:
        count = len(design.problem.targets)
        yield f"no target poses given: {count} poses spread over the joint limits stand for them"


def _unguarded(design: Design) -> Iterator[str]:
    cell = design.problem.cell
    bare = not set(cell.shapes.capsules) - {"base"}
    if bare and cell.design.obstacles:
        yield "the arm is not checked against the obstacles: [robot.capsules_mm] is missing"
    elif bare and cell.design.floor is not None:
        yield "only the markers are checked against the floor: [robot.capsules_mm] is missing"


def _shapes(design: Design) -> Iterator[str]:
    """What was taken from the robot's file without a line in the cell, and how to change it."""
    cell = design.problem.cell
    if cell.shapes.own:
        count = sum(len(own) for own in cell.shapes.capsules.values())
        yield (
            f"the arm is checked against itself by {count} capsules around the shapes in the robot's "
            "file. [robot.capsules_mm] replaces them"
        )
    if len(cell.shapes.unread) > 1:
        more = f" and {len(cell.shapes.unread) - 3} more" if len(cell.shapes.unread) > 3 else ""
        yield f"shapes that cannot be read: {', '.join(cell.shapes.unread[:3])}{more}"
    for floor in design.problem.constraints:
        if isinstance(floor, Floor) and floor.exempt:
            yield f"not checked against the floor, as always below it: {', '.join(floor.exempt)}"


def _exempt(design: Design) -> Iterator[str]:
    for constraint in design.problem.constraints:
        if isinstance(constraint, SelfCollision) and constraint.exempt:
            pairs = ", ".join(f"{a} with {b}" for a, b in constraint.exempt)
            where = (
                "at every pose or at zero:" if design.problem.cell.shapes.own else "at every pose:"
            )
            yield f"not checked against each other, as they touch {where} {pairs}"


def _hidden(design: Design) -> Iterator[str]:
    hidden, points = design.assessment.hidden, design.assessment.points
    if hidden:
        yield f"{hidden} of {points} points are out of sight and do not count"


def _knots(design: Design) -> Iterator[str]:
    problem = design.problem
    for effect in problem.model.effects:
        if isinstance(effect, StiffnessVsAngle) and effect.where not in problem.cell.knots:
            levels = design.levels
            if levels is not None and problem.cell.robot.joints[levels.joint] == effect.where:
                continue
            angles = ", ".join(f"{np.degrees(knot):.6g}" for knot in effect.knots)
            yield (
                f"stiffness_vs_angle:{effect.where} has its coefficients at {angles} deg. Write "
                f"{effect.where} = [{angles}] into [model.knots_deg], so that all commands use the same"
            )


def _reapproaches(design: Design) -> Iterator[str]:
    """What second visits tell, what they cost, and how to plan without them."""
    found = design.reapproaches
    if found is None:
        return
    count, both = len(found.again), {"translation": found.translation, "rotation": found.rotation}
    told = [f"+-{100 * std:.0f} % ({name})" for name, std in both.items() if std > 0.0]
    unsure = ", if it is well above the noise of the instrument"
    yield (
        f"{count} of the {len(design.poses)} stops are repeat visits. They show the arm's "
        f"repeatability to {' and '.join(told) or f'+-{100 * found.common:.0f} %'}"
        f"{'' if design.problem.cell.scatters else unsure}"
    )
    if np.isfinite(found.task_rms_instead):
        now, instead = design.assessment.task_rms * 1e3, found.task_rms_instead * 1e3
        yield (
            f"{count} new poses in their place would lower the expected error from {now:.3g} mm to "
            f"{instead:.3g} mm{'' if found.asked else ' (--reapproach 0)'}"
        )


def _odd_limits(design: Design) -> Iterator[str]:
    yield from odd_limits(design.problem.cell.robot)


_NOTES = (
    _odd_limits,
    _reapproaches,
    _unplanned,
    _common,
    _unseen,
    _no_targets,
    _left_out,
    _weak,
    _outside,
    _unmoved,
    _unguarded,
    _shapes,
    _exempt,
    _hidden,
    _knots,
)
