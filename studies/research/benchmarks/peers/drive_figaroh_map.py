"""FIGAROH's estimators with a prior on the sizes of errors: full geometry of all joints.

``map`` holds them about zero by the sizes that it brings (1 mm, 2 mrad, 20 mrad of a joint's offset),
``map_cv`` scales these by one factor of 0.1 to 10, chosen by five-fold cross-validation. Base and tool
are free. The noise is given: an estimate needs more readings than parameters.
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
from drive_figaroh import Calibration, settings
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.tools.robot import load_robot


def solve(folder: Path, work: dict[str, Any], way: str) -> dict[str, Any]:
    """One estimator, with its time and predictions."""
    path = settings(folder, work | {"compliant": []}, False)
    config = json.loads(path.read_text())
    estimation = {"method": way, "noise_std": work["sigma"]}
    config["tasks"]["calibration"]["parameters"]["estimation"] = estimation
    path.write_text(json.dumps(config))
    begun = time.process_time()
    try:
        robot = load_robot(str(folder / "robot.urdf"), load_by_urdf=True)
        own = Calibration(robot, str(path))
        own.initialize()
        result = own.solve(enable_logging=False)
    except Exception as error:  # whatever it is, it is its answer
        return {"way": way, "failed": f"{type(error).__name__}: {error}"}
    table = np.genfromtxt(folder / "heldout.csv", delimiter=",", names=True)
    joints = np.column_stack([table[name] for name in work["joints"]])
    own.calib_config["NbSample"] = len(joints)
    flat = calc_updated_fkm(own.model, own.data, result.x, joints, own.calib_config)
    shaped = flat.reshape(len(work["markers"]), 3, len(joints))
    return {
        "way": way,
        "failed": "",
        "free": len(result.x),
        "seconds": time.process_time() - begun,
        "converged": bool(result.success),
        "heldout": shaped.transpose(2, 0, 1).tolist(),
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    folder, answer = Path(sys.argv[1]), Path(sys.argv[2])
    work = json.loads((folder / "work.json").read_text())
    with contextlib.redirect_stdout(io.StringIO()):
        runs = [solve(folder, work, way) for way in work["ways"]]
    answer.write_text(json.dumps({"version": version("figaroh"), "runs": runs}))
