"""Plans for cameras: every pose seen, what they promise kept, and poses saved, by other code than ours.

    python -m studies.research.benchmarks.camera_plans [--arm kr270 ..] [--on tip ..] [--days 200]

A Panda, a UR5e and a KR 270 have a camera on the hand or in the world and a board of 8 x 11 corners on
the other side; their long links have shapes. Each pose is checked with MuJoCo's kinematics by OpenCV's
``projectPoints``, and by ``findChessboardCornersSB`` in the image that MuJoCo renders, arm and all
(``MUJOCO_GL=egl`` or ``osmesa``). The days are read by an arm in plain numpy that is off, with OpenCV's
pixels; how the estimates scatter is set against the covariance that was predicted for the plan: 1 is
perfect, and p is that of its chi-square.

By hand: as many poses whose optical axis goes through the middle of the board, drawn at random, or
evenly over a hemisphere of one radius without a turn about the axis. ``like`` are poses of a plan, 8
or more, at which the error at the targets is no larger than theirs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from defusedxml import ElementTree

import calib
import doe
from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.cell.views import NUMBERS, looking, views_of
from calib.poses import Measurements, Poses, poses_at
from doe.constraints import scene_of, visible
from studies.compare.experiment import experiment_of
from studies.demo.embedded import embedded_text
from studies.research.bench import (
    Output,
    Row,
    bench,
    clocked,
    count,
    data_folder,
    each,
    several,
    table,
)
from studies.research.benchmarks.camera_starts import ARMS
from studies.research.benchmarks.planned_days import Arm
from studies.research.cameras import corners, frame, pixels, quaternion, standing
from studies.research.refits import Refits
from studies.research.withheld.truth import urdf

_SIZE, _FOCAL, _CENTER, _NOISE = (1280, 960), 900.0, (639.5, 479.5), 0.1  # px
_ACROSS, _DOWN = 11, 8  # corners
_LEAST = 10.0  # px of a square: there noise is sqrt(5) times that of a large one
_MARGIN, _TILT = 10.0, np.radians(60.0)
_LONG = 0.25  # m, links that have a shape
_DRAWN = 600  # views by hand
_THERE = 1e-3  # m and rad, from what is wanted by hand
_OFF = 2e-4  # m and rad by which each joint is off
_CELL = """schema = 1
[robot]
urdf = "robot.urdf"
base = "{base}"
tip = "{tip}"
[robot.capsules_mm]
{shapes}
[boards.board]
on = "{other}"
squares = [12, 9]
pitch_mm = {pitch}
{board}
[instruments.camera]
kind = "camera"
on = "{on}"
focal_px = 900
center_px = [639.5, 479.5]
image_px = [1280, 960]
sigma_px = 0.1
{camera}
[model]
effects = ["base", "tool", "geometry"]
"""
Standing = tuple[tuple[float, float, float], tuple[float, float, float]]
"""m, and deg about fixed x, y, z."""


@dataclass(frozen=True)
class Place:
    """An arm and where camera and board are, by where the camera is.

    pitch : mm of a square; radius : m, of the links
    """

    urdf: Callable[[], str]
    base: str
    tip: str
    pitch: float
    radius: float
    places: dict[str, tuple[Standing, Standing]]

    def links(self) -> Iterator[tuple[str, str, Array]]:
        """Joint, link, and where the next joint is on it, of the long ones."""
        joints = ElementTree.fromstring(self.urdf()).findall("joint")
        for joint, after in pairwise(joints):
            there = np.array(after.find("origin").get("xyz").split(), dtype=float)
            if joint.get("type") == "revolute" and np.linalg.norm(there) > _LONG:
                yield joint.get("name"), joint.find("child").get("link"), there

    def cell(self, folder: Path, on: str) -> calib.Cell:
        """The cell with its camera on the tip or in the world, through its files."""
        around = 1e3 * self.radius
        shapes = "\n".join(
            f"{name} = [{{from = [0, 0, 0], to = {(1e3 * there).tolist()}, radius = {around}}}]"
            for name, _, there in self.links()
        )
        camera, board = (
            f"position_mm = {[1e3 * x for x in position]}\nrpy_deg = {list(rpy)}"
            for position, rpy in self.places[on]
        )
        text = _CELL.format(
            base=self.base, tip=self.tip, shapes=shapes, pitch=self.pitch, on=on,
            other={"tip": "world", "world": "tip"}[on], camera=camera, board=board,
        )  # fmt: skip
        (folder / "robot.urdf").write_text(self.urdf())
        (folder / "cell.toml").write_text(text)
        return calib.load_cell(folder / "cell.toml")

    @property
    def corners(self) -> Array:
        """The board's corners in its frame, shape (88, 3), m."""
        return corners(_ACROSS, _DOWN, 1e-3 * self.pitch)


_DOWNWARD = (180.0, 0.0, 0.0)
_IN_HAND: Standing = ((0.05, 0.0, 0.05), (0.0, 0.0, 90.0))
PLACES = {
    "panda": Place(
        lambda: (data_folder("panda_sockets_2") / "robot.urdf").read_text(),
        "base_link", "tool0", 20.0, 0.06,
        {"tip": (_IN_HAND, ((0.5, -0.11, 0.0), _DOWNWARD)),
         "world": (((1.25, 0.0, 0.5), (-90.0, 0.0, 90.0)), ((-0.12, 0.09, 0.05), _DOWNWARD))},
    ),
    "ur5e": Place(
        lambda: urdf(ARMS["ur5e"].arm, masses=False), "base", "tip", 20.0, 0.05,
        {"tip": (_IN_HAND, ((-0.6, 0.11, 0.0), _DOWNWARD)),
         "world": (((-1.5, 0.0, 0.4), (-90.0, 0.0, -90.0)), ((-0.12, 0.09, 0.05), _DOWNWARD))},
    ),
    "kr270": Place(
        lambda: embedded_text("kr270.urdf"), "base_link", "tool0", 40.0, 0.15,
        {"tip": (((0.08, 0.0, 0.06), (0.0, 90.0, 0.0)), ((1.5, -0.1, 0.3), _DOWNWARD)),
         "world": (((3.8, 0.0, 1.8), (-90.0, 0.0, 90.0)), ((0.05, -0.18, -0.24), (0.0, -90.0, 0.0)))},
    ),
}  # fmt: skip


@bench(
    several("--arm", sorted(PLACES)),
    several("--on", ["tip", "world"], help="Where the camera is."),
    count("--poses", 40, least=10),
    count("--candidates", 4000, least=500),
    days=200,
    days_help="Simulated days, shared among the plans.",
    workers=True,
)
def main(
    arm: Sequence[str],
    on: Sequence[str],
    poses: int,
    candidates: int,
    days: int,
    seed: int,
    workers: int,
) -> Output:
    """Plan for each camera, look, measure, and compare with poses by hand."""
    share = max(2, -(-days // (len(arm) * len(on))))
    tasks = [(name, place, poses, candidates, share, seed) for name in arm for place in on]
    rows = each(a_plan, tasks, workers)
    total = {key: sum(row[key] for row in rows) for key in ("poses", "in sight", "found")}
    said = "{in sight} of {poses} poses are in sight, the board is found in {found}".format(**total)
    return [table([{k: v for k, v in row.items() if k != "days"} for row in rows]), said], rows


def a_plan(name: str, on: str, poses: int, candidates: int, days: int, seed: int) -> Row:
    """One plan and all that is measured of it."""
    place = PLACES[name]
    with tempfile.TemporaryDirectory() as folder:
        cell = place.cell(Path(folder), on)
    rng = np.random.default_rng(seed)
    rivals = {
        "look-at": by_hand(cell, _at_random(rng), poses, rng),
        "hemisphere": _over_hemisphere(cell, poses, rng),
    }

    def plan(count: int) -> doe.Design:
        return doe.design(
            cell, poses=count, candidates=candidates, reapproach=0, seed=seed,
            against=rivals if count == poses else None,
        )  # fmt: skip

    found, seconds = clocked(lambda: plan(poses))
    rms = found.assessment.task_rms
    row: Row = {"arm": name, "camera on": on, "poses": poses}
    row |= looked_at(place, on, found.poses.q)
    row |= {
        "at targets [mm]": f"{1e3 * rms:.3f}",
        **promised(place, on, cell, found.poses, days, rng),
    }
    for rival, judged in found.rivals.items():
        theirs = judged.assessment.task_rms
        row[f"{rival} [mm]"] = f"{1e3 * theirs:.3f}"
        row[f"like {rival}"] = _equal(plan, theirs, poses * (rms / theirs) ** 2)
    return {**row, "plan, CPU [s]": f"{seconds:.0f}"}


def _equal(plan: Callable[[int], doe.Design], rms: float, about: float) -> int:
    """Poses of the smallest plan tried that is as good; about : where to begin."""
    least = max(8, round(0.9 * about))
    while plan(least).assessment.task_rms > rms:
        least += 1
    return least


# -- poses by hand -------------------------------------------------------------------------------


def by_hand(cell: calib.Cell, wanted: Array, poses: int, rng: np.random.Generator) -> Poses:
    """The first of the views (m, 6) that the arm comes to and sees, in their order."""
    low, high = cell.robot.sample_limits().T
    free, none = np.ones(cell.robot.dof, dtype=bool), np.zeros(len(wanted), dtype=int)
    best = np.full((len(wanted), cell.robot.dof), np.nan)
    (view,) = views_of(cell)
    goal = view.tips(view.placed(wanted, cell.robot.reach))[:, :3]
    for _ in range(8):
        q = rng.uniform(low, high, (len(wanted), cell.robot.dof))
        q = looking(cell, q, none, wanted, free)
        frames = forward(cell.robot, q)
        there = np.concatenate([frames.R[:, -1], frames.o[:, -1, :, None]], axis=2)
        seen = np.abs(there - goal).max(axis=(1, 2)) < _THERE
        seen &= visible(scene_of(cell, q)).all(axis=1) & np.isnan(best[:, 0])
        best[seen] = q[seen]
    good = best[np.isfinite(best[:, 0])]
    if len(good) < poses:
        raise calib.CalibError(f"{len(good)} poses by hand see the board, not {poses}")
    return poses_at(good[:poses])


def _at_random(rng: np.random.Generator) -> Array:
    even = rng.uniform(size=(_DRAWN, NUMBERS))
    even[:, 4:] = 0.5
    return even


def _over_hemisphere(cell: calib.Cell, poses: int, rng: np.random.Generator) -> Poses:
    """Of the radii, and turns about the optical axis, the first with enough that the arm comes to."""
    for radius, turn in product((0.4, 0.2, 0.6, 0.0, 0.8), (0.0, 0.25, 0.5, 0.75)):
        even = np.full((_DRAWN, NUMBERS), 0.5)
        even[:, 0] = (np.arange(_DRAWN) + 0.5) / _DRAWN  # cosine of the tilt
        even[:, 1] = np.arange(_DRAWN) * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0
        even[:, 2:4] = turn, radius
        with suppress(calib.CalibError):
            return by_hand(cell, rng.permutation(even), poses, rng)
    raise calib.CalibError("the arm comes to no hemisphere")


# -- every pose is seen --------------------------------------------------------------------------


def looked_at(place: Place, on: str, q: Array) -> Row:
    """How many poses are in sight by OpenCV's projection, and in how many images it finds the board."""
    import cv2

    sight = found = 0
    off = []
    for T, image in Studio(place, on).images(q):
        uv = pixels(place.corners, T, _FOCAL, _CENTER)
        viewed = place.corners @ T[:3, :3].T + T[:3, 3]
        cosine = viewed @ T[:3, 2] / np.linalg.norm(viewed, axis=1)
        inside = (uv >= _MARGIN - 0.01) & (uv <= np.array(_SIZE) - _MARGIN + 0.01)
        sight += bool(inside.all() and (cosine >= np.cos(_TILT) - 1e-4).all())
        shown, at = cv2.findChessboardCornersSB(image, (_ACROSS, _DOWN))
        if shown:
            beyond = [np.linalg.norm(own - uv, axis=1).max() for own in (at[:, 0], at[::-1, 0])]
            off.append(min(beyond))
            found += off[-1] < 1.0
    return {
        "in sight": sight,
        "found": found,
        "farthest corner [px]": f"{max(off, default=np.nan):.2f}",
    }


class Studio:
    """An arm, a printed board and a camera in MuJoCo, which reads the URDF by itself."""

    def __init__(self, place: Place, on: str) -> None:
        import mujoco

        spec = mujoco.MjSpec.from_string(place.urdf())
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
        spec.compiler.boundmass, spec.compiler.boundinertia = 1e-3, 1e-6
        spec.visual.quality.offsamples, spec.visual.map.znear = 8, 1e-3
        spec.visual.global_.offwidth, spec.visual.global_.offheight = (2 * n for n in _SIZE)
        spec.visual.headlight.ambient = [0.9, 0.9, 0.9]
        spec.visual.headlight.diffuse = spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        capsule, r = mujoco.mjtGeom.mjGEOM_CAPSULE, place.radius
        for _, link, there in place.links():
            ends = [0.0, 0.0, 0.0, *there]
            spec.body(link).add_geom(
                type=capsule, fromto=ends, size=[r, 0, 0], rgba=[0.9, 0.5, 0.1, 1]
            )
        camera, board = place.places[on]
        carrier = {"tip": spec.body(place.tip), "world": spec.worldbody}
        self._print(spec, carrier[{"tip": "world", "world": "tip"}[on]], board, 1e-3 * place.pitch)
        fovy = np.degrees(2.0 * np.arctan(_SIZE[1] / 2.0 / _FOCAL))
        turned = standing(*camera)[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # it looks along -z
        carrier[on].add_camera(name="camera", pos=camera[0], quat=quaternion(turned), fovy=fovy)
        self.model = spec.compile()

    def _print(self, spec: Any, carrier: Any, at: Standing, pitch: float) -> None:
        """Twelve squares across and nine down with half a square of white about them."""
        import cv2
        import mujoco

        i, j = np.indices((900, 1200)) // 100
        paper = np.where((i + j) % 2 == 0, 0, 255).astype(np.uint8)
        paper = cv2.copyMakeBorder(paper, 50, 50, 50, 50, cv2.BORDER_CONSTANT, value=255)
        spec.assets = {"print.png": cv2.imencode(".png", paper)[1].tobytes()}
        spec.add_texture(name="print", type=mujoco.mjtTexture.mjTEXTURE_2D, file="print.png")
        material = spec.add_material(name="print", specular=0.0, shininess=0.0)
        textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
        textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "print"
        material.textures = textures
        (a, b), (c, d) = (-0.5 * pitch, 12.5 * pitch), (-0.5 * pitch, 9.5 * pitch)
        spec.add_mesh(
            name="print",
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            uservert=[a, c, 0, b, c, 0, b, d, 0, a, d, 0, (a + b) / 2, (c + d) / 2, 1e-3],
            userface=[0, 2, 1, 0, 3, 2, 0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4],
            usertexcoord=[0, 0, 1, 0, 1, 1, 0, 1, 0.5, 0.5],
        )
        body = carrier.add_body(name="print", pos=at[0], quat=quaternion(standing(*at)[:3, :3]))
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="print", material="print")

    def images(self, q: Array) -> Iterator[tuple[Array, Any]]:
        """Of each pose the board (4, 4) in camera axes, and a grey image."""
        import cv2
        import mujoco

        data = mujoco.MjData(self.model)
        camera, board = self.model.camera("camera").id, self.model.body("print").id
        with mujoco.Renderer(self.model, 2 * _SIZE[1], 2 * _SIZE[0]) as renderer:
            for own in q:
                data.qpos[:] = own
                mujoco.mj_forward(self.model, data)
                there, eye = np.eye(4), np.eye(4)
                eye[:3, :3] = data.cam_xmat[camera].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
                eye[:3, 3] = data.cam_xpos[camera]
                there[:3, :3], there[:3, 3] = data.xmat[board].reshape(3, 3), data.xpos[board]
                renderer.update_scene(data, camera="camera")
                grey = cv2.cvtColor(renderer.render(), cv2.COLOR_RGB2GRAY)
                yield (
                    np.linalg.inv(eye) @ there,
                    cv2.resize(grey, _SIZE, interpolation=cv2.INTER_AREA),
                )


# -- what is promised is kept --------------------------------------------------------------------


def promised(
    place: Place, on: str, cell: calib.Cell, plan: Poses, days: int, rng: np.random.Generator
) -> Row:
    """The squared scatter of estimates by the covariance that was predicted, and its chi-square."""
    experiment = experiment_of(cell, plan)
    arm = Arm(cell.robot, _OFF * rng.normal(size=(cell.robot.dof, 6)))
    exact = _exact(place, on, arm, experiment.poses.q)
    sigma = _NOISE * np.sqrt(1.0 + (2.0 * _LEAST / _sides(place, exact)) ** 2)
    fits = []
    for _ in range(days):
        readings = exact + sigma[:, None, None] * rng.normal(size=exact.shape)
        unstated = np.full(experiment.seen.shape, np.nan)
        data = Measurements(experiment.poses, readings, experiment.seen, unstated)
        fits.append(calib.identify(cell, data))
    found = Refits.of(experiment, fits)
    return {
        "days": days,
        "scatter / foreseen": f"{found.over_foreseen:.3f}",
        "p": f"{2.0 * min(found.p, 1.0 - found.p):.2f}",
    }


def _exact(place: Place, on: str, arm: Arm, q: Array) -> Array:
    """Pixels (m, 88, 2) of the true arm."""
    camera, board = (standing(*own) for own in place.places[on])
    found = []
    for R, p in zip(*arm.tips(q), strict=True):
        tip = frame(p, R)
        eye, there = (tip @ camera, board) if on == "tip" else (camera, tip @ board)
        T = np.linalg.inv(eye) @ there
        found.append(pixels(place.corners, T, _FOCAL, _CENTER))
    return np.array(found)


def _sides(place: Place, uv: Array) -> Array:
    """px of a square across where it is foreshortened most, shape (m,)."""
    paper = np.column_stack([place.corners[:, :2], np.ones(len(place.corners))])
    slopes = np.array([np.linalg.lstsq(paper, own)[0][:2] for own in uv])
    return np.asarray(1e-3 * place.pitch * np.linalg.svd(slopes, compute_uv=False)[:, -1])


if __name__ == "__main__":
    main()
