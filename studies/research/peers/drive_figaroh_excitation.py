"""FIGAROH's exciting trajectories: splines of least condition number of the base regressor, by IPOPT.

    python drive_figaroh_excitation.py ROBOT.urdf JOINT,JOINT,.. MOTIONS SECONDS ANSWER.npz

One segment a motion, each beside those before it, within the URDF's positions, speeds and efforts. It
needs cyipopt.
"""

import contextlib
import io
import json
import logging
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from drive_figaroh_motions import identification
from figaroh.optimal.base_optimal_trajectory import (
    BaseOptimalTrajectory,
    BaseTrajectoryIPOPTProblem,
)
from figaroh.tools.robot import load_robot

RATE, WAYPOINTS, ITERATIONS = 25, 6, 25  # Hz; of a motion; of IPOPT, as each takes seconds


class Excitation(BaseOptimalTrajectory):  # type: ignore[misc]
    """Its own problem, as it stands."""

    def create_ipopt_problem(self, *given: Any) -> Any:
        return BaseTrajectoryIPOPTProblem(self, *given)


def settings(place: Path, joints: list[str], lasts: float) -> Path:
    """FIGAROH's configuration."""
    trajectory = {
        "type": "optimal_trajectory",
        "joints": {"active_joints": joints},
        "problem": {"max_iterations": ITERATIONS, "segment_attempts": 3},
        "trajectory": {
            "waypoints": WAYPOINTS, "frequency": RATE, "segment_duration": lasts / (WAYPOINTS - 1)
        },
    }  # fmt: skip
    tasks = {"identification": identification(joints), "optimal_trajectory": trajectory}
    # JSON is YAML too.
    place.write_text(json.dumps({"robot": {"name": "robot"}, "tasks": tasks}))
    return place


if __name__ == "__main__":
    logging.disable(logging.ERROR)
    urdf, joints, answer = sys.argv[1], sys.argv[2].split(","), Path(sys.argv[5])
    np.random.seed(0)  # noqa: NPY002
    begun, every = time.process_time(), list(range(len(joints)))
    with contextlib.redirect_stdout(io.StringIO()):
        robot = load_robot(urdf, load_by_urdf=True)
        config = settings(answer.with_suffix(".yaml"), joints, float(sys.argv[4]))
        own = Excitation(robot, joints, str(config))
        own.identif_config |= {"act_idxq": every, "act_idxv": every}
        own.initialize()
        found = own.solve(int(sys.argv[3]))
    np.savez(answer, q=np.array(found["P_F"]), seconds=time.process_time() - begun)
