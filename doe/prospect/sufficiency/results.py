"""The answer in the units of the file formats."""

from __future__ import annotations

import math
from typing import Any

from calib.model import Model
from doe.prospect.sufficiency.answer import Enough
from doe.prospect.sufficiency.forecast import Step

_MM = 1e3


def enough_fields(answer: Enough, planned: int) -> dict[str, Any]:
    """The fields of ``enough --json``, without provenance.

    planned : int, poses of the plan
    """
    model, found = answer.model, answer.found
    now, *coming = answer.steps
    return {
        "status": "too_few" if found is None else found.status,
        "reason": answer.why or None,
        "noise": {
            "sigma_mm": answer.sigma * _MM,
            "source": "cell" if found is None else found.noise.source,
        },
        "lacking": {
            "rms_mm": answer.lacking.rms * _MM,
            "scatter_mm": answer.lacking.scatter * _MM,
            "unexplained_mm": answer.lacking.unexplained.rms * _MM,
            "unexplained_from": answer.lacking.unexplained.source,
        },
        "plan": {"poses": planned, "measured": answer.match.poses, "to_measure": len(coming)},
        "now": {**_step(now), "parameters": _parameters(model, now)},
        "order": [_step(step) for step in coming],
        "end": {**_step(answer.steps[-1]), "parameters": _parameters(model, answer.steps[-1])},
        "goal_mm": None if answer.goal is None else answer.goal * _MM,
        "goal_beyond_reach": answer.beyond_reach,
        "poses_to_goal": answer.needed,
        "fresh_poses_to_goal": answer.fresh_needed,
        "fresh": [_step(step) for step in answer.fresh],
        "pays_until": answer.pays_until,
        "warnings": list(answer.match.warnings),
    }


def _step(step: Step) -> dict[str, Any]:
    return {
        "pose": step.pose or None,
        "readings": step.readings,
        "task_rms_mm": step.task_rms * _MM,
        "task_worst_mm": step.task_worst * _MM,
        "task_most_mm": step.task_most * _MM,
        "from_parameters_mm": step.from_parameters * _MM,
        "unidentifiable": list(step.open),
    }


def _parameters(model: Model, step: Step) -> list[dict[str, Any]]:
    """Standard deviations; ``share`` is that of the size which such errors have."""
    return [
        {
            "id": p.id,
            "effect": p.effect,
            "where": p.where,
            "name": p.name,
            "std": None if math.isnan(std) else std / p.scale,
            "unit": p.unit,
            "share": None if math.isnan(std) else std / p.size,
        }
        for p, std in zip(model.parameters, step.std, strict=True)
    ]
