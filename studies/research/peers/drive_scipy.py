"""What a user writes in a day: axes as lines in space and SciPy's ``least_squares``, NumPy alone.

Each joint turns about a line in the instrument's frame at zero angles, four parameters a line, and
carries the markers, three parameters each: a complete description of the geometry without redundancy.
Fitted with the analytic Jacobian and with the numerical one.
"""

import json
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation


def lines_of(urdf: Path, tip: str) -> tuple[Any, Any, Any]:
    """Directions and points of the nominal axes, (n, 3), and the tip's frame, at zero angles."""
    chain, link = [], tip
    joints = {j.find("child").get("link"): j for j in ET.parse(urdf).iter("joint")}  # type: ignore[union-attr]  # noqa: S314
    while link in joints:
        chain.append(joints[link])
        link = joints[link].find("parent").get("link")  # type: ignore[union-attr, assignment]
    T, directions, points = np.eye(4), [], []
    for joint in reversed(chain):
        at = joint.find("origin")
        step = np.eye(4)
        if at is not None:
            step[:3, 3] = [float(x) for x in at.get("xyz", "0 0 0").split()]
            rpy = [float(x) for x in at.get("rpy", "0 0 0").split()]
            step[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        T = T @ step
        if joint.get("type") == "revolute":
            axis = [float(x) for x in joint.find("axis").get("xyz").split()]  # type: ignore[union-attr]
            directions.append(T[:3, :3] @ axis)
            points.append(T[:3, 3])
    return np.array(directions), np.array(points), T


def turned(x: Any, w: Any, angle: Any) -> Any:
    """Vectors x, (m, .., 3), turned about the unit vector w by angles, (m,), Rodrigues."""
    c, s = (f(angle).reshape(-1, *[1] * (x.ndim - 1)) for f in (np.cos, np.sin))
    return x * c + np.cross(w, x) * s + (x @ w)[..., None] * w * (1.0 - c)


class Arm:
    """Lines and markers about a start; what it remembers are its directions across each line."""

    def __init__(self, directions: Any, points: Any, q: Any, measured: Any) -> None:
        self.w, self.at, self.q, self.measured = directions, points, q, measured
        across = np.eye(3)[np.abs(directions).argmin(axis=1)]
        self.u = np.cross(directions, across)
        self.u /= np.linalg.norm(self.u, axis=1, keepdims=True)
        self.v = np.cross(directions, self.u)

    def predict(self, x: Any, q: Any) -> tuple[Any, Any]:
        """Points, shape (m, markers, 3), and their Jacobian, shape (m, markers, 3, p)."""
        n = len(self.w)
        tilt, shift = x[: 4 * n].reshape(2, n, 2)
        raw = self.w + tilt[:, :1] * self.u + tilt[:, 1:] * self.v
        size = np.linalg.norm(raw, axis=1)
        w = raw / size[:, None]
        at = self.at + shift[:, :1] * self.u + shift[:, 1:] * self.v
        markers = x[4 * n :].reshape(-1, 3)
        m, k = len(q), len(markers)
        points = np.broadcast_to(markers, (m, k, 3))
        J = np.zeros((m, k, 3, len(x)))
        for j in range(k):
            J[:, j, :, 4 * n + 3 * j : 4 * n + 3 * j + 3] = np.eye(3)
        for i in reversed(range(n)):
            own = points - at[i]
            c, s = np.cos(q[:, i])[:, None, None], np.sin(q[:, i])[:, None, None]
            cos1 = 1.0 - c
            J = np.moveaxis(turned(np.moveaxis(J, 3, 2), w[i], q[:, i]), 2, 3)
            for way, d in enumerate((self.u[i], self.v[i])):
                dw = (d - (d @ w[i]) * w[i]) / size[i]
                along = (own @ w[i])[..., None]
                J[..., 2 * i + way] = (
                    np.cross(dw, own) * s + (along * dw + (own @ dw)[..., None] * w[i]) * cos1
                )
                still = np.broadcast_to(d, (m, 1, 3))
                J[..., 2 * n + 2 * i + way] = d - turned(still, w[i], q[:, i])
            points = at[i] + turned(own, w[i], q[:, i])
        return points, J

    def errors(self, x: Any) -> Any:
        return (self.predict(x, self.q)[0] - self.measured).ravel()

    def jacobian(self, x: Any) -> Any:
        return self.predict(x, self.q)[1].reshape(self.measured.size, -1)


def start(directions: Any, points: Any, q: Any, measured: Any, guess: Any) -> tuple[Any, Any, Any]:
    """Axes and markers in the instrument's frame: base and markers fitted in turn, nominal arm."""
    zero = np.zeros(4 * len(directions))
    local = guess.copy()
    basis = np.vstack([np.zeros(3), np.eye(3)])
    moved = Arm(directions, points, q, measured).predict(np.append(zero, basis.ravel()), q)[0]
    origin, turns = moved[:, 0], moved[:, 1:] - moved[:, :1]  # rows of turns: images of the axes
    for _ in range(50):
        carried = origin[:, None] + np.einsum("ka,maj->mkj", local, turns)
        ours, theirs = carried.reshape(-1, 3), measured.reshape(-1, 3)
        R = Rotation.align_vectors(theirs - theirs.mean(0), ours - ours.mean(0))[0].as_matrix()
        t = theirs.mean(0) - R @ ours.mean(0)
        back = (measured - t) @ R - origin[:, None]
        local = np.einsum("mkj,maj->ka", back, turns) / len(q)
    return directions @ R.T, points @ R.T + t, local @ R.T + t


def table(path: Path, names: list[str]) -> Any:
    """Columns of a file, shape (rows, names)."""
    rows = np.genfromtxt(path, delimiter=",", names=True)
    return np.column_stack([rows[name] for name in names])


def main(folder: Path, answer: Path, repeats: int) -> None:
    """Do the work and write the answer."""
    work = json.loads((folder / "work.json").read_text())
    guess = np.array(list(work["markers"].values()))
    directions, points, tip = lines_of(folder / "robot.urdf", work["tip"])
    q = table(folder / "fit.csv", work["joints"])
    names = [f"{axis}{k + 1}" for k in range(len(guess)) for axis in "xyz"]
    measured = table(folder / "fit.csv", names).reshape(len(q), -1, 3)
    runs = []
    for way in ("analytic", "numerical"):
        seconds: list[float] = []
        while len(seconds) < repeats and sum(seconds) < work["enough_s"]:
            begun = time.process_time()
            w, at, markers = start(
                directions, points, q, measured, guess @ tip[:3, :3].T + tip[:3, 3]
            )
            arm = Arm(w, at, q, measured)
            first = np.append(np.zeros(4 * len(w)), markers.ravel())
            jacobian = arm.jacobian if way == "analytic" else "2-point"
            found = least_squares(arm.errors, first, jac=jacobian, method="lm")
            seconds.append(time.process_time() - begun)
        held = table(folder / "heldout.csv", work["joints"])
        runs.append(
            {
                "way": f"least_squares, {way} Jacobian",
                "free": len(first),
                "seconds": seconds,
                "converged": bool(found.success),
                "fit": arm.predict(found.x, q)[0].tolist(),
                "heldout": arm.predict(found.x, held)[0].tolist(),
            }
        )
    answer.write_text(json.dumps({"version": scipy.__version__, "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
