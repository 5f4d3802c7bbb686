"""FIGAROH by its own way, YAML and a subclass: full geometry, and with compliance of some joints.

Release 1.0.2 with a free base writes the base's six names over those of the compliances, which come
first in its list, so none would be fitted. They are put back after its choice of parameters.
"""

import contextlib
import io
import json
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.tools.robot import load_robot

CAP = 1e9  # m: no outlier is left out, as none is by the others


class Calibration(BaseCalibration):  # type: ignore[misc]
    """Unweighted points in the instrument's frame; base and markers unknown."""

    def __init__(self, robot: Any, config: str) -> None:
        super().__init__(robot, config)
        self.calib_config["known_baseframe"] = self.calib_config["known_tipframe"] = False

    def cost_function(self, var: Any) -> Any:
        estimated = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        return self._compute_logmap_residuals(self.PEE_measured, estimated, position_frame="world")


def settings(folder: Path, work: dict[str, Any], compliance: bool) -> Path:
    """FIGAROH's configuration of the work."""
    marker = {"measurable_dof": [True, True, True, False, False, False]}
    task = {
        "type": "kinematic_calibration",
        "kinematics": {"base_frame": "universe", "tool_frame": work["tip"]},
        "joints": {"active_joints": work["joints"]},
        "parameters": {
            "calibration_level": "full_params",
            "include_non_geometric": compliance,
            "outlier_threshold": CAP,
        },
        "measurements": {"markers": [marker] * len(work["markers"])},
        "data": {"source_file": str(folder / "fit.csv")},
    }
    path = folder / f"figaroh_{compliance}.yaml"
    # JSON is YAML too.
    path.write_text(json.dumps({"robot": {"name": work["name"]}, "tasks": {"calibration": task}}))
    return path


def solve(folder: Path, work: dict[str, Any], compliance: bool, repeats: int) -> dict[str, Any]:
    """One way of fitting, with its times and predictions."""
    seconds: list[float] = []
    while len(seconds) < repeats and sum(seconds) < work["enough_s"]:
        robot = load_robot(str(folder / "robot.urdf"), load_by_urdf=True)
        own = Calibration(robot, str(settings(folder, work, compliance)))
        loaded = [
            name
            for name in own.calib_config["param_name"]
            if any(name.endswith(joint) for joint in work["compliant"])
        ]
        begun = time.process_time()
        own.initialize()
        if compliance:
            own.calib_config["param_name"] += loaded
        result = own.solve(enable_logging=False)
        seconds.append(time.process_time() - begun)
    predicted = {}
    for table in ("fit", "heldout"):
        q = np.genfromtxt(folder / f"{table}.csv", delimiter=",", names=True)
        joints = np.column_stack([q[name] for name in work["joints"]])
        config = dict(own.calib_config, NbSample=len(joints))
        flat = calc_updated_fkm(own.model, own.data, result.x, joints, config)
        shaped = flat.reshape(len(work["markers"]), 3, len(joints))
        predicted[table] = shaped.transpose(2, 0, 1).tolist()
    return {
        "way": "full geometry" + (", compliance" if compliance else ""),
        "free": len(result.x),
        "seconds": seconds,
        "converged": bool(result.success),
        **predicted,
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    folder, answer, repeats = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    work = json.loads((folder / "work.json").read_text())
    with contextlib.redirect_stdout(io.StringIO()):
        runs = [solve(folder, work, c, repeats) for c in (False, True)]
    answer.write_text(json.dumps({"version": version("figaroh"), "runs": runs}))
