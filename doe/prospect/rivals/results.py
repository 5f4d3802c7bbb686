"""Next poses in the units of the file formats."""

from __future__ import annotations

from typing import Any

from calib.arm.robot import Robot
from doe.prospect.rivals.next_poses import NextPoses
from doe.results import joint_fields


def next_fields(result: NextPoses, robot: Robot) -> dict[str, Any]:
    """The fields of ``diagnose --json`` about what to measure next."""
    return {
        "next_poses": [
            {
                "pose": name,
                **joint_fields(robot, q),
                "splits": [list(pair) for pair in splits],
            }
            for name, q, splits in zip(
                result.poses.names, result.poses.q, result.splits, strict=True
            )
        ],
        "next_poses_predicted": [
            {
                "rivals": list(prediction.rivals),
                "probability_now": prediction.now,
                "probability_after": prediction.after,
                "interventions": [
                    {
                        "intervention": remedy.name,
                        "says": remedy.says,
                        "probability": remedy.probability,
                    }
                    for remedy in prediction.remedies
                ],
                "inseparable": prediction.inseparable,
            }
            for prediction in result.predictions
        ],
        "next_poses_assume": list(result.assumptions),
    }
