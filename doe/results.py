"""A design in the units of the file formats: degrees, millimetres, names that people read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.results import at_targets
from doe.assess import Assessment
from doe.plan import Design, Step

_MM = 1e3


def design_fields(design: Design) -> dict[str, Any]:
    """The fields of ``design --json``, without provenance."""
    problem, proof, judged = design.problem, design.certificate, design.assessment
    robot, criterion = problem.cell.robot, problem.criterion
    level = shown_levels(design)
    unit = "deg"
    if design.levels is not None and robot.prismatic[design.levels.joint]:
        unit = "mm"
    named = {} if design.levels is None else {robot.joints[design.levels.joint]: sorted(set(level))}
    return {
        "criterion": criterion.name,
        "criterion_unit": criterion.unit,
        "larger_is_better": criterion.larger_is_better,
        "value": _finite(design.value),
        "bound": _finite(design.bound),
        "efficiency": design.efficiency,
        "proof": {
            "weighted_value": criterion.shown(proof.weighted),
            "solver_gap": proof.solver_share,
            "before_polish": {
                "value": criterion.shown(proof.pool_value),
                "bound": criterion.shown(proof.pool_bound),
                "efficiency": min(1.0, proof.pool_value / proof.pool_bound),
            },
            "proved_optimal": proof.optimal,
            "nodes": proof.nodes,
            "fresh_bound": None if math.isnan(proof.fresh) else criterion.shown(proof.fresh),
            "efficiency_fresh": None
            if math.isnan(proof.fresh)
            else min(1.0, proof.value / proof.fresh),
            "agreement_of_starts": proof.agreement,
            "surviving_candidates": design.candidates.survivors,
            "rounds": proof.rounds,
        },
        "poses": [
            {
                "pose": name,
                **joint_fields(robot, q),
                "level": None if math.isnan(own) else own,
            }
            for name, q, own in zip(design.poses.names, design.poses.q, level, strict=True)
        ],
        f"levels_{unit}": named,
        "predicted_std": [
            {
                "name": p.name,
                "effect": p.effect,
                "where": p.where,
                "id": p.id,
                "std": _finite(std / p.scale),
                "unit": p.unit,
            }
            for p, std in zip(problem.model.parameters, judged.std, strict=True)
        ],
        **_accuracy(judged),
        "targets": str(problem.cell.design.get("targets") or f"{len(problem.targets)} Sobol poses"),
        "at_targets": at_targets(robot, problem.targets, judged.at_targets),
        "survives": {
            "loss_of_pose": {
                "worst": None
                if not len(judged.without_pose)
                else design.poses.names[int(judged.without_pose.argmax())],
                "task_rms_mm": _finite(judged.without_pose.max(initial=0.0) * _MM),
                "criterion": _finite(criterion.shown(proof.left)) if proof.left > 0.0 else None,
                "efficiency": proof.kept(problem.request.poses, problem.request.fixed is None),
            },
            "loss_of_marker": {
                name: _finite(rms * _MM) for name, rms in judged.without_marker.items()
            },
        },
        "candidates": {
            "drawn": design.candidates.drawn,
            "feasible": design.candidates.feasible,
            "removed_by": design.candidates.removed_by,
        },
        "joint_travel_deg": math.degrees(design.travel),
        "reference": _reference(design),
        "reapproaches": _reapproaches(design),
        "extends": None if problem.request.fixed is None else len(problem.request.fixed),
        "against": {
            name: {
                "poses": rival.poses,
                "value": _finite(rival.assessment.value),
                "efficiency": rival.efficiency,
                **_accuracy(rival.assessment),
            }
            for name, rival in design.rivals.items()
        },
        "curve": [_step(step) for step in design.curve],
        "notes": list(design.notes),
        "seconds": sum(design.seconds.values()),
        "seconds_by_part": design.seconds,
    }


def shown_levels(design: Design) -> list[float]:
    """Level of each pose in degrees or mm, NaN without levels."""
    if design.levels is None:
        return [math.nan] * len(design.level)
    slides = bool(design.problem.cell.robot.prismatic[design.levels.joint])
    shown = design.level * _MM if slides else np.degrees(design.level)
    return [float(value) for value in np.round(shown, 6) + 0.0]


def joint_fields(robot: Robot, q: Array) -> dict[str, dict[str, float]]:
    """Joint values by name: ``joints_deg``, and ``joints_mm`` where some slide."""
    found: dict[str, dict[str, float]] = {"joints_deg": {}}
    for joint, slides, value in zip(robot.joints, robot.prismatic, q, strict=True):
        key, shown = ("joints_mm", value * _MM) if slides else ("joints_deg", math.degrees(value))
        found.setdefault(key, {})[joint] = round(float(shown), 6) + 0.0
    return found


def _reference(design: Design) -> dict[str, Any] | None:
    found = design.reference
    if found is None:
        return None
    robot, at = design.problem.cell.robot, design.poses.names.index(found.pose)
    return {
        "pose": found.pose,
        **joint_fields(robot, design.poses.q[at]),
        "poses": list(found.repeats),
        "every": found.every,
    }


def _reapproaches(design: Design) -> dict[str, Any] | None:
    found = design.reapproaches
    if found is None:
        return None
    return {
        "poses": list(found.poses),
        "again": list(found.again),
        "dof": found.dof,
        "repeatability_relative_std": {
            "common": _finite(found.common),
            "translation": _finite(found.translation),
            "rotation": _finite(found.rotation),
        },
    }


def _accuracy(judged: Assessment) -> dict[str, Any]:
    return {
        "task_rms_mm": _finite(judged.task_rms * _MM),
        "task_worst_mm": _finite(judged.task_worst * _MM),
        "determinant": _finite(judged.determinant),
        "trace": _finite(judged.trace),
        "observability": {name: _finite(value) for name, value in judged.observability.items()},
    }


def _step(step: Step) -> dict[str, Any]:
    return {
        "poses": step.poses,
        "value": _finite(step.value),
        "task_rms_mm": _finite(step.task_rms * _MM),
        "efficiency": step.efficiency,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
