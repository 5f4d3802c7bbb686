"""FIGAROH's dynamic identification by its own class: base parameters by QR, friction, armature, offset.

Runs come filtered, so its own filter is passed by; runs of the standard options, and weighted again.
"""

import contextlib
import io
import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced
from figaroh.tools.robot import load_robot


class Identification(BaseIdentification):  # type: ignore[misc]
    """Filtered angles, speeds, accelerations and torques of all runs, one after the other."""

    def __init__(self, robot: Any, config: str, fit: Any) -> None:
        self.fit = fit
        super().__init__(robot, config)
        every = list(range(fit.shape[-1]))
        self.identif_config |= {"act_idxq": every, "act_idxv": every}

    def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
        del data_source
        q, v, a, torque = self.fit
        return {"timestamps": np.arange(len(q)), "positions": q, "velocities": v,
                "accelerations": a, "torques": torque}  # fmt: skip

    def filter_kinematics_data(self, filter_config: Any = None) -> None:
        del filter_config
        self.processed_data = dict(self.raw_data)

    def process_torque_data(self, **options: Any) -> Any:
        del options
        # One joint after the other, as the regressor's rows are.
        return np.asarray(self.raw_data["torques"]).ravel(order="F")


def identification(joints: list[str]) -> dict[str, Any]:
    """FIGAROH's task: base parameters with friction, armature and offset of every joint."""
    zeros = [0.0] * len(joints)
    return {
        "type": "dynamic_identification",
        "joints": {"active_joints": joints},
        "mechanics": {
            "friction_coefficients": {"viscous": zeros, "static": zeros},
            "actuator_inertias": zeros, "joint_offsets": zeros,
            "reduction_ratios": [1.0] * len(joints),
        },
        "coupling": {"has_coupled_wrist": False},
        "problem": {"model_components": {
            "friction": True, "actuator_inertia": True, "joint_offset": True}},
        "signal_processing": {"sampling_frequency": 100.0, "cutoff_frequency": 8.0},
    }  # fmt: skip


def settings(folder: Path, joints: list[str]) -> Path:
    """FIGAROH's configuration."""
    path = folder / "figaroh_motions.yaml"
    tasks = {"identification": identification(joints)}
    # JSON is YAML too.
    path.write_text(json.dumps({"robot": {"name": "ur10e"}, "tasks": tasks}))
    return path


def main(folder: Path, answer: Path) -> None:
    """Do the work and write the answer."""
    work = np.load(folder / "motions.npz")
    config = settings(folder, work["joints"].tolist())
    runs = []
    for weighted in (False, True):
        robot = load_robot(str(folder / "robot.urdf"), load_by_urdf=True)
        begun = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            own = Identification(robot, str(config), work["fit"])
            own.initialize()
            phi = own.solve(decimate=False, plotting=False, wls=weighted)
        seconds = time.process_time() - begun
        q, v, a = work["heldout"]
        W = build_regressor_basic(robot, q, v, a, own.identif_config)
        W = build_regressor_reduced(W, own._idx_eliminated)[:, own._base_indices]
        torque = (W @ phi)[: q.size].reshape(q.shape, order="F")
        way = "weighted least squares" if weighted else "least squares"
        runs.append({
            "way": f"{len(phi)} base parameters with friction, armature, offset; {way}",
            "seconds": seconds, "heldout": torque.tolist(),
        })  # fmt: skip
    answer.write_text(json.dumps({"version": version("figaroh"), "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
