"""pybotics: a modified DH chain through the first marker, the only one that its robot can carry.

Base, marker and chain start where those of ``drive_scipy`` do, which costs it no time. Parallel axes
get a fixed link between them, so that the chain can tilt one against the other. Its residual is the
length of each error, without direction; SciPy's ``trf`` runs with both of its scalings, capped.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from drive_scipy import lines_of, start, table
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares

STEPS = 60  # evaluations of the Jacobian, at most


def chain_of(w: Any, at: Any) -> tuple[Any, Any, list[int], Any, Any]:
    """Chain of lines in the instrument's frame, directions w and points at, shape (n, 3), mm.

    Returns alpha, a, theta, d, shape (L, 4); which of them to fit; the joint that turns each link, -1
    where none does; the frames before the first link and after the last.
    """
    frames, parallel = [], [False]
    for i in range(len(w) - 1):
        normal = np.cross(w[i], w[i + 1])
        gap = at[i + 1] - at[i]
        parallel.append(bool(np.linalg.norm(normal) < 1e-6))
        if parallel[-1]:
            x, foot = gap - (gap @ w[i]) * w[i], at[i]
        else:
            along = np.linalg.lstsq(np.array([w[i], -w[i + 1]]).T, gap, rcond=None)[0][0]
            x, foot = normal, at[i] + along * w[i]
        x = x / np.linalg.norm(x)
        frames.append(np.column_stack([x, np.cross(w[i], x), w[i], foot]))
    onto = frames[-1][:, 0]  # of the last link nothing is known but its axis
    foot = at[-1] + ((frames[-1][:, 3] - at[-1]) @ w[-1]) * w[-1]
    frames.append(np.column_stack([onto, np.cross(w[-1], onto), w[-1], foot]))
    first = frames[0]
    links: list[tuple[list[float], list[bool], int]] = [([0.0] * 4, [False] * 4, 0)]
    for k in range(1, len(w)):
        before, own = frames[k - 1], frames[k]
        x, gap = before[:, 0], own[:, 3] - before[:, 3]
        alpha = np.arctan2(np.cross(before[:, 2], own[:, 2]) @ x, before[:, 2] @ own[:, 2])
        theta = np.arctan2(np.cross(x, own[:, 0]) @ own[:, 2], x @ own[:, 0])
        a, d, last = gap @ x, gap @ own[:, 2], k == len(w) - 1
        values, free = [alpha, a, theta, d], [True, True, not last, not last and not parallel[k]]
        if parallel[k]:
            links.append(([alpha + np.pi / 2, a, 0.0, 0.0], [True, True, True, False], -1))
            values[:2], free[:2] = [-np.pi / 2, 0.0], [False, False]
        links.append((values, free, k))
    rows, mask, joint = zip(*links, strict=True)
    return np.array(rows), np.array(mask).ravel(), list(joint), first, frames[-1]


def main(folder: Path, answer: Path, repeats: int) -> None:
    """Do the work and write the answer."""
    work = json.loads((folder / "work.json").read_text())
    guess = np.array(list(work["markers"].values()))
    directions, points, tip = lines_of(folder / "robot.urdf", work["tip"])
    given = table(folder / "fit.csv", work["joints"])
    held = table(folder / "heldout.csv", work["joints"])
    names = [f"{axis}{k + 1}" for k in range(len(guess)) for axis in "xyz"]
    measured = table(folder / "fit.csv", names).reshape(len(given), -1, 3)
    zero = guess @ tip[:3, :3].T + tip[:3, 3]
    w, at, markers = start(directions, points, given, measured, zero)
    rows, mask, joint, first, last = chain_of(w, 1e3 * at)
    by_link = lambda q: np.insert(q, q.shape[1], 0.0, axis=1)[:, joint]  # noqa: E731
    goal, runs = 1e3 * measured[:, 0], []
    for way, scale in (("x_scale 1", 1.0), ("x_scale jac", "jac")):
        seconds: list[float] = []
        while len(seconds) < repeats and sum(seconds) < work["enough_s"]:
            robot = Robot.from_parameters(rows)
            robot.world_frame = np.vstack([first, [0, 0, 0, 1]])
            robot.tool.position = last[:, :3].T @ (1e3 * markers[0] - last[:, 3])
            handler = OptimizationHandler(robot, mask, [True] * 3 + [False] * 3, [True] * 6)
            x, begun = handler.generate_optimization_vector(), time.process_time()
            found = least_squares(
                optimize_accuracy, x, args=(handler, by_link(given), goal), x_scale=scale,
                max_nfev=STEPS,
            )  # fmt: skip
            seconds.append(time.process_time() - begun)
        handler.apply_optimization_vector(found.x)
        predicted = [
            [[(handler.robot.fk(angles)[:3, 3] / 1e3).tolist()] for angles in by_link(q)]
            for q in (given, held)
        ]
        converged = found.status > 0
        runs.append(
            {"way": f"one marker, {way}", "free": len(x), "seconds": seconds,
             "converged": converged, "fit": predicted[0], "heldout": predicted[1]}
        )  # fmt: skip
    answer.write_text(json.dumps({"version": version("pybotics"), "runs": runs}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
