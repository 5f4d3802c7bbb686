"""What a reader should know about a plan: at most eight notes, and what its error takes for granted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arm.robot import odd_limits
from calib.effects.elastic import StiffnessVsAngle
from calib.instruments.camera import Camera
from doe.constraints.self_collision import SelfCollision
from doe.parameters import by_reason
from doe.plan import Design


def granted_by(design: Design) -> tuple[str, ...]:
    """What the expected error takes for granted, in words that follow "taking for granted"."""
    cell, judged = design.problem.cell, design.assessment
    blind = ", ".join(cell.unseen_joints)
    cameras = [own for own in cell.instruments if isinstance(own, Camera)]
    endless = ", ".join(own.name for own in cameras if own.image is None)
    granted = {
        f"{len(design.problem.targets)} poses spread over the joint limits as targets": (
            cell.design.targets is None
        ),
        f"{blind} exact and rigid, as no instrument sees them err": bool(blind),
        f"images of {endless} without an edge, as no image_px is given": bool(endless),
        f"{judged.hidden} of {judged.points} points out of sight": judged.hidden > 0,
    }
    return tuple(text for text, applies in granted.items() if applies)


def notes_of(design: Design) -> tuple[str, ...]:
    """What a reader should know about a plan, a sentence or two for each rule that applies."""
    limits = odd_limits(design.problem.cell.robot)
    notes = [" ".join(sentences) for sentences in (limits, *(rule(design) for rule in _NOTES))]
    return tuple(note for note in notes if note)


def _repeat_visits(design: Design) -> Iterator[str]:
    """What second visits show."""
    if visits := design.reapproaches:
        yield (
            f"{len(visits.again)} of the {len(design.poses)} stops are repeat visits. They show the "
            f"arm's repeatability to +-{100 * visits.error:.0f} %, if it is well above the noise of "
            "the instrument."
        )


def _unplanned(design: Design) -> Iterator[str]:
    if left := design.problem.unplanned:
        yield (
            f"not planned for, as a plan chooses no order, sides and times: {', '.join(left)}. "
            "posecal diagnose --plan-only says what a plan shows of such causes."
        )
    if lost := design.problem.left_out:
        yield f"not planned for, as the arm's own weight does not show it: {by_reason(lost)}"


def _weak(design: Design) -> Iterator[str]:
    model, std = design.problem.model, design.assessment.std
    pairs = zip(model.parameters, std <= model.sizes, strict=True)
    if weak := [p.id for p, determined in pairs if not determined]:
        yield (
            f"this plan hardly determines {', '.join(weak[:6])}{' ..' * (len(weak) > 6)}. Do not "
            f"identify them from it, or plan with criterion A or D in place of {design.criterion}"
        )


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


def _checked(design: Design) -> Iterator[str]:
    """Which shapes of the robot's file are checked, and which are exempt."""
    shapes = design.problem.cell.shapes
    if shapes.own:
        yield (
            f"The arm is checked against itself by {sum(map(len, shapes.capsules.values()))} capsules "
            "around the shapes in the robot's file. [robot.capsules_mm] replaces them."
        )
    where = "at every pose or at zero" if shapes.own else "at every pose"
    for constraint in design.problem.constraints:
        if isinstance(constraint, SelfCollision) and constraint.exempt:
            pairs = ", ".join(f"{a} with {b}" for a, b in constraint.exempt)
            yield f"Not checked against each other, as they touch {where}: {pairs}."


def _coefficients(design: Design) -> Iterator[str]:
    """Where coefficients stand that neither the cell nor the levels place."""
    cell, levels = design.problem.cell, design.levels
    at = None if levels is None else cell.robot.joints[levels.joint]
    for effect in design.problem.model.effects:
        if isinstance(effect, StiffnessVsAngle) and effect.where not in (at, *cell.knots):
            angles = ", ".join(f"{np.degrees(knot):.6g}" for knot in effect.knots)
            yield (
                f"stiffness_vs_angle:{effect.where} has its coefficients at {angles} deg. Write "
                f"{effect.where} = [{angles}] into [model.knots_deg], so that all commands use the "
                "same."
            )


_NOTES = (_repeat_visits, _unplanned, _weak, _unmoved, _checked, _coefficients)
