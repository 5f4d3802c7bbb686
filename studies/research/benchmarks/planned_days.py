"""A planned day for a camera, a ballbar and a pair of sockets, on the KR 270 of the demo or on a Panda.

    python -m studies.research.benchmarks.planned_days [--poses 40] [--refits 20] [--only NAME ..]
        [--panda]

Each plan is chosen and proved by ``doe.design``, read by an arm that is off, in plain numpy that shares
no code with planner and estimator, and identified by ``calib.identify`` again and again. How the
estimates scatter about their mean is set against the covariance that was predicted for the plan. The
Panda is that of ``panda_sockets_2`` under ``POSECAL_DATA``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import click
import numpy as np
from scipy.spatial.transform import Rotation

import calib
import doe
from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.poses import Measurements, Poses
from studies.compare.experiment import experiment_of
from studies.demo.embedded import embedded_text
from studies.research.bench import Output, Row, bench, cell_from, clocked, count, data_folder, table
from studies.research.refits import Refits
from studies.research.withheld.robots import LIGHT, Joint
from studies.research.withheld.truth import tip_in_numpy

TRACKER_POSES = 15
LIMITS = "[robot.limits_deg]\nA2 = [-140.0, -0.01]"
HEAD = """
schema = 1
[robot]
urdf = "robot.urdf"
base = "base_link"
tip = "tool0"
{}
[model]
effects = ["base", "tool", "geometry"]
"""
_SOCKET = '[instruments.{}]\nkind = "socket"\nsigma_mm = 0.05\nposition_mm = {}\n'
_CAMERA = """
[boards.board]
on = "tip"
squares = [5, 4]
pitch_mm = {pitch}
position_mm = {board}
[instruments.camera]
kind = "camera"
focal_px = 2400
center_px = [2000, 1500]
image_px = [4000, 3000]
sigma_px = 0.2
position_mm = {stands}
rpy_deg = [-90, 0, 90]
"""
_APART = "[[known_distances]]\nbetween = ['left', 'right']\nmm = {}\nsigma_mm = 0.005\n"
NAMES = ("tracker, 0.01 mm", "camera, 0.2 px", "ballbar, 0.005 mm", "two sockets, 0.05 mm")
_FOCAL, _CENTRE = 2400.0, np.array([2000.0, 1500.0])
_AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # x, y, z of the camera


@dataclass(frozen=True)
class Place:
    """An arm and what stands around it, mm, base axes; ball and board on the tip.

    limits : lines of the cell beneath [robot]; reach : of the bar; left, right : the sockets
    """

    limits: str
    ball: tuple[float, ...]
    board: tuple[float, ...]
    pitch: float
    camera: tuple[float, ...]
    anchor: tuple[float, ...]
    reach: tuple[float, ...]
    left: tuple[float, ...]
    right: tuple[float, ...]

    def urdf(self) -> str:
        """The file of the arm."""
        if self is KR270:
            return embedded_text("kr270.urdf")
        return (data_folder("panda_sockets_2") / "robot.urdf").read_text()

    def cell(self, name: str) -> str:
        """The cell of a day."""
        ball = f"[markers_mm]\nball = {list(self.ball)}\n"
        bar = f"anchor_mm = {list(self.anchor)}\nreach_mm = {list(self.reach)}\n"
        sockets = _SOCKET.format("left", list(self.left)) + _SOCKET.format(
            "right", list(self.right)
        )
        apart = _APART.format(math.dist(self.left, self.right))
        seen = {"pitch": self.pitch, "board": list(self.board), "stands": list(self.camera)}
        own = {
            NAMES[0]: '[instruments.tracker]\nkind = "points"\nsigma_mm = 0.01\n',
            NAMES[1]: _CAMERA.format(**seen),
            NAMES[2]: f'[instruments.bar]\nkind = "distance"\nsigma_mm = 0.005\n{bar}',
            NAMES[3]: sockets + apart,
        }
        return HEAD.format(self.limits) + ball + own[name]


KR270 = Place(
    limits=LIMITS,
    ball=(279.2, -16.4, -91.9), board=(200, -100, 0), pitch=60, camera=(4000, 0, 1500),
    anchor=(1700, 0, 300), reach=(700, 1500), left=(1700, 300, 700), right=(1700, -300, 700),
)  # fmt: skip
PANDA = Place(
    limits="",
    ball=(60, 30, 100), board=(40, -40, 60), pitch=25, camera=(1700, 0, 600),
    anchor=(500, 0, 50), reach=(200, 500), left=(500, 100, 250), right=(500, -100, 250),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm by its nominal robot, whose kinematics are NumPy's, and what the links are off by.

    off : ndarray, shape (n, 6), m and rad, displacement of each joint's frame
    """

    robot: Robot
    off: Array

    def tips(self, q: Array) -> tuple[Array, Array]:
        """R (m, 3, 3) and p (m, 3), m."""
        turns = Rotation.from_matrix(self.robot.origins[:, :3, :3]).as_euler("xyz")
        frames = list(zip(self.robot.origins[:, :3, 3].tolist(), turns.tolist(), strict=True))
        joints = tuple(
            Joint(name, xyz, tuple(axis), -np.inf, np.inf, 0.0, (0.0, 0.0, 0.0), rpy=rpy)
            for name, (xyz, rpy), axis in zip(
                self.robot.joints, frames, self.robot.axes.tolist(), strict=False
            )
        )
        arm = replace(LIGHT, joints=joints, tip_xyz=frames[-1][0], tip_rpy=frames[-1][1])
        return tip_in_numpy(arm, q, np.pad(self.off, ((1, 1), (0, 0))))

    def points(self, q: Array, markers: Array) -> Array:
        """Markers (n, 3) at configurations, (m, n, 3), m."""
        R, p = self.tips(q)
        return np.asarray(np.einsum("mij,nj->mni", R, markers) + p[:, None])


def read(
    arm: Arm, place: Place, cell: calib.Cell, plan: Poses, seen: Mask, rng: np.random.Generator
) -> Measurements:
    """What a cell's instrument reads of a plan; into a socket the arm is brought by Newton's steps."""
    kind, q = cell.instruments[0].kind, plan.q
    site = plan.site
    if kind == "socket" and site is not None:
        goal = 1e-3 * np.array([place.left, place.right])[(site == "right").astype(int)]
        goal = goal + 5e-5 * rng.normal(size=(len(q), 3))
        q = _brought(arm, q, cell.markers[:1], goal)
        readings = np.zeros((len(q), 1, 3))
    else:
        points = arm.points(q, cell.markers)
        if kind == "camera":
            own = (points - 1e-3 * np.array(place.camera)) @ _AXES.T
            pixels = _FOCAL * own[..., :2] / own[..., 2:] + _CENTRE
            readings = pixels + 0.2 * rng.normal(size=pixels.shape)
        elif kind == "distance":
            there = 1e-3 * np.array(place.anchor)
            away = np.sqrt(((points - there) ** 2).sum(axis=-1, keepdims=True))
            readings = away + 5e-6 * rng.normal(size=away.shape)
        else:
            readings = points + 1e-5 * rng.normal(size=points.shape)
    unstated = np.full(seen.shape, np.nan)
    return Measurements(replace(plan, q=q), readings * seen[..., None], seen, unstated)


def _brought(arm: Arm, q: Array, marker: Array, goal: Array) -> Array:
    for _ in range(12):
        steps = 1e-6 * np.eye(q.shape[1])
        ends = [arm.points(q + h, marker) - arm.points(q - h, marker) for h in steps]
        J = np.stack([end[:, 0] for end in ends], axis=-1) / 2e-6
        off = goal - arm.points(q, marker)[:, 0]
        q = q + (np.linalg.pinv(J) @ off[..., None])[..., 0]
    return q


def day(place: Place, name: str, poses: int, refits: int, task: float | None) -> tuple[Row, float]:
    """A row of the table, and the RMS foreseen at the targets, m.

    task : the same of the tracker's poses, None for that of this day itself
    """
    cell = cell_from(place.cell(name), place.urdf())
    design = partial(doe.design, cell, criterion="D", candidates=2000, reapproach=0)
    found, seconds = clocked(partial(design, poses=poses))
    experiment = experiment_of(cell, found.poses)
    rng = np.random.default_rng(0)
    arm = Arm(cell.robot, 2e-4 * rng.normal(size=(cell.robot.dof, 6)))
    fits = []
    for _ in range(refits):
        length = [
            replace(k, length=k.length + k.sigma * rng.normal()) for k in cell.known_distances
        ]
        data = read(arm, place, cell, experiment.poses, experiment.seen, rng)
        fits.append(calib.identify(replace(cell, known_distances=tuple(length)), data))
    scattered = Refits.of(experiment, fits)
    rms = found.assessment.task_rms
    matching = poses if task is None else poses * (rms / task) ** 2
    row = {
        "instrument": name,
        "poses": poses,
        "efficiency": f"{found.efficiency:.3f}",
        "at targets [mm]": f"{rms * 1e3:.3f}",
        "scatter / foreseen": f"{scattered.over_foreseen:.3f}",
        "p": f"{scattered.p:.2f}",
        "poses like 15 of the tracker": f"{matching:.0f}",
        "plan [s]": f"{seconds:.0f}",
    }
    return row, rms


@bench(
    count("--poses", 40, least=15),
    count("--refits", 20, least=2),
    click.option("--only", multiple=True, help="Parts of their names, beside the tracker."),
    click.option("--panda", is_flag=True, help="On a Panda."),
)
def main(poses: int, refits: int, only: tuple[str, ...], panda: bool, seed: int) -> Output:
    """Plan, read and identify each day."""
    del seed
    place = PANDA if panda else KR270
    first, task = day(place, NAMES[0], TRACKER_POSES, refits, None)
    names = [name for name in NAMES[1:] if any(part in name for part in only or ("",))]
    rows = [first, *(day(place, name, poses, refits, task)[0] for name in names)]
    return [table(rows)], rows


if __name__ == "__main__":
    main()
