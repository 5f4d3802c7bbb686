"""A compensation in the units of the file formats."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib import Compensation
from calib.arm.robot import Robot
from calib.arrays import Array
from doe.results import joint_fields

_MM = 1e3


def compensation_fields(robot: Robot, found: Compensation) -> dict[str, Any]:
    """The fields of ``compensate --json``, without provenance."""
    errors = {"before": found.before, "left": found.left, "expected": found.expected}
    return {
        "errors_at": found.at,
        "rms_mm": {
            **{key: found.rms(values) * _MM for key, values in errors.items()},
            "from_parameters": found.rms(found.spread) * _MM,
            "scatter": found.rms(found.scatter) * _MM,
            "unexplained": found.unexplained.rms * _MM,
        },
        "p95_mm": {key: float(np.quantile(v, 0.95)) * _MM for key, v in errors.items()},
        "max_mm": {key: float(v.max()) * _MM for key, v in errors.items()},
        "unexplained_from": found.unexplained.source,
        "limited": {
            reason: found.limited_by.count(reason) for reason in sorted({*found.limited_by} - {""})
        },
        "warnings": list(found.notes),
        "targets": [_target(robot, found, i) for i in range(len(found.q))],
    }


def _target(robot: Robot, found: Compensation, i: int) -> dict[str, Any]:
    return {
        "pose": found.targets.names[i],
        **joint_fields(robot, found.q[i]),
        **_prefixed("nominal", robot, found.targets.q[i]),
        **_prefixed("correction", robot, found.correction[i]),
        "before_mm": float(found.before[i]) * _MM,
        "left_mm": float(found.left[i]) * _MM,
        "from_parameters_mm": float(found.spread[i]) * _MM,
        "scatter_mm": float(found.scatter[i]) * _MM,
        "expected_mm": float(found.expected[i]) * _MM,
        "turn_before_mrad": float(found.turn_before[i]) * 1e3,
        "turn_left_mrad": float(found.turn_left[i]) * 1e3,
        "limited_by": found.limited_by[i] or None,
    }


def _prefixed(prefix: str, robot: Robot, q: Array) -> dict[str, dict[str, float]]:
    return {f"{prefix}_{key}": values for key, values in joint_fields(robot, q).items()}
