"""robotkinecal: axes as twists, from one marker's points and from poses that three markers give.

Lines in the instrument's frame start where those of ``drive_scipy`` do, which costs it no time. It
stops where the norm of its errors changes by less than 1e-4, a limit that it does not let be set.
"""

import contextlib
import io
import json
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import roboticstoolbox as rtb
from drive_scipy import lines_of, start, table
from robotkinecal import SerialRobotKineCal
from scipy.spatial.transform import Rotation
from spatialmath import SE3


def body_of(measured: Any) -> tuple[Any, Any]:
    """Poses, (m, 4, 4), of a body whose shape, (markers, 3), is the mean of what was measured."""
    shape, T = measured[0] - measured[0].mean(axis=0), np.tile(np.eye(4), (len(measured), 1, 1))
    for _ in range(3):
        for pose, points in zip(T, measured, strict=True):
            pose[:3, 3] = points.mean(axis=0)
            pose[:3, :3] = Rotation.align_vectors(points - pose[:3, 3], shape)[0].as_matrix()
        shape = ((measured - T[:, None, :3, 3]) @ T[:, :3, :3]).mean(axis=0)
    return T, shape


def main(folder: Path, answer: Path, repeats: int) -> None:
    """Do the work and write the answer."""
    work = json.loads((folder / "work.json").read_text())
    guess = np.array(list(work["markers"].values()))
    directions, points, at_tip = lines_of(folder / "robot.urdf", work["tip"])
    q, held = (table(folder / f"{name}.csv", work["joints"]) for name in ("fit", "heldout"))
    names = [f"{axis}{k + 1}" for k in range(len(guess)) for axis in "xyz"]
    measured = table(folder / "fit.csv", names).reshape(len(q), -1, 3)
    zero = guess @ at_tip[:3, :3].T + at_tip[:3, 3]
    w, at, markers = start(directions, points, q, measured, zero)
    bodies, shape = body_of(measured)
    first = np.eye(4)  # of the body, at zero angles
    first[:3, 3] = markers.mean(axis=0)
    first[:3, :3] = Rotation.align_vectors(markers - first[:3, 3], shape)[0].as_matrix()
    given = {
        "one marker": ([np.array(p) for p in measured[:, 0]], SE3(*markers[0]), np.zeros((1, 3))),
        "poses of three markers": ([SE3(T, check=False) for T in bodies], SE3(first), shape),
    }  # fmt: skip
    runs = []
    for way, (observed, at_zero, local) in given.items():
        seconds: list[float] = []
        while len(seconds) < repeats and sum(seconds) < work["enough_s"]:
            links = [rtb.PoERevolute(d, p) for d, p in zip(w, at, strict=True)]
            own = SerialRobotKineCal(rtb.PoERobot(links, at_zero))
            # The toolbox counts the tool as one more link, without an axis.
            own.joint_screw_axis = [s for s in own.joint_screw_axis if np.any(s[3:])]
            own.N_JOINTS = len(w)
            own.set_observations(list(q), observed)
            begun = time.process_time()
            with contextlib.redirect_stdout(io.StringIO()):
                result = own.solve()
            seconds.append(time.process_time() - begun)
        tip = partial(own.forward_kinematics, len(w) + 1)
        predicted = [
            [(local @ T.R.T + T.t).tolist() for T in map(tip, angles)] for angles in (q, held)
        ]  # fmt: skip
        runs.append(
            {"way": way, "free": own.N_PARAMS, "seconds": seconds,
             "converged": bool(result.has_converged), "fit": predicted[0], "heldout": predicted[1]}
        )  # fmt: skip
    answer.write_text(json.dumps({"version": version("robotkinecal"), "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
