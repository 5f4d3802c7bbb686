"""Plans that are carried out: what each promises at its targets, beside fits of days that follow it.

    python -m studies.research.executed [--only Justin] .. [--days 40] [--json FILE]

Three cameras, two trackers that see past an arm, a SCARA, and the humanoid Agile Justin, whose two arms
of seven joints hang on one torso. MuJoCo reads the URDF by itself; then every link is off by tenths of
a millimetre and of a milliradian, every instrument, board and marker by millimetres. Pixels are
OpenCV's.

``promised`` is the expected error at the targets, ``scattered`` what the fits of all days scatter about
their mean there. The ratio is that of ``scattered`` to ``promised``, with its own standard error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

import calib
import doe
from calib.arrays import Array
from doe.constraints import scene_of, visible
from doe.information import target_rows
from studies.demo.embedded import embedded_text
from studies.research.bench import Output, Row, bench, data_folder, each, several, table
from studies.research.truth.arms import LIGHT, SCARA, Triple
from studies.research.truth.mechanism import urdf

_OFF = np.repeat([3e-4, 4e-4], 3)  # m and rad, of every link
_STANDS = np.full(6, 2e-3)  # m and rad, of every instrument and board
_MARKER = 1e-3  # m
_SIGMA_MM, _SIGMA_PX = 0.01, 0.1
_SMALL = 10.0  # px of a square whose corners are sqrt(5) times as noisy as those of a large one
_FOCAL, _CENTRE, _IMAGE = 900.0, (639.5, 479.5), (1280, 960)
_ACROSS, _DOWN = 11, 8  # corners
_CANDIDATES = 4000
Standing: TypeAlias = tuple[Triple, Triple]
"""Where something is: mm, and deg about fixed x, y, z."""


def frame(at: Standing) -> Array:
    """The same as a matrix (4, 4), m."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", at[1], degrees=True).as_matrix()
    T[:3, 3] = 1e-3 * np.array(at[0])
    return T


def displaced(T: Array, by: Array) -> Array:
    """A frame moved along and turned about its own axes by (6,), m and rad."""
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = Rotation.from_rotvec(by[3:]).as_matrix(), by[:3]
    return np.asarray(T @ moved)


def _keys(at: Standing) -> str:
    return f"position_mm = {list(at[0])}\nrpy_deg = {list(at[1])}\n"


class Truth:
    """A robot as MuJoCo reads its URDF, with links that are off."""

    def __init__(self, text: str, rng: np.random.Generator) -> None:
        import mujoco

        spec = mujoco.MjSpec.from_string(text)
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
        spec.compiler.boundmass, spec.compiler.boundinertia = 1e-3, 1e-6
        self.model: Any = spec.compile()
        self.data, self._pose = mujoco.MjData(self.model), mujoco.mj_kinematics
        for body in range(1, self.model.nbody):
            off, turn = _OFF * rng.normal(size=6), np.roll(self.model.body_quat[body], -1)
            self.model.body_pos[body] += Rotation.from_quat(turn).apply(off[:3])
            turned = Rotation.from_quat(turn) * Rotation.from_rotvec(off[3:])
            self.model.body_quat[body] = np.roll(turned.as_quat(), 1)

    def poses(self, joints: tuple[str, ...], q: Array) -> Iterator[Truth]:
        """The robot at joints (m, n), one after the other."""
        where = [self.model.joint(name).qposadr[0] for name in joints]
        for own in q:
            self.data.qpos[where] = own
            self._pose(self.model, self.data)
            yield self

    def link(self, name: str) -> Array:
        """A link's frame (4, 4) in the base's axes, m; ``world`` does not move."""
        T = np.eye(4)
        if name != "world":
            T[:3, :3] = self.data.body(name).xmat.reshape(3, 3)
            T[:3, 3] = self.data.body(name).xpos
        return T


@dataclass(frozen=True)
class Trackers:
    """Trackers of markers.

    markers : link and place in it, mm, by name; the first link is the tip
    stands : of each tracker, mm, by name, turned anyhow; none of one that stands anywhere
    """

    markers: dict[str, tuple[str, Triple]]
    stands: dict[str, Triple]

    def cell(self) -> str:
        """Tables of a cell."""
        lines = ["[markers_mm]\n"]
        tip = next(iter(self.markers.values()))[0]
        for name, (link, at) in self.markers.items():
            on = "" if link == tip else f', on = "{link}"'
            lines.append(f"{name} = {{ position = {list(at)}{on} }}\n")
        if not self.stands:
            return "".join([*lines, f"[instrument]\nsigma_mm = {_SIGMA_MM}\n"])
        for name, at in self.stands.items():
            place = f"sigma_mm = {_SIGMA_MM}\nposition_mm = {list(at)}\n"
            lines.append(f'[instruments.{name}]\nkind = "points"\n{place}')
        return "".join(lines)

    def drawn(self, rng: np.random.Generator) -> Callable[[Truth], tuple[Array, float]]:
        """What is exactly read, (C, 3), and its noise, of places that are off."""
        seats = [
            (link, 1e-3 * np.array(at) + _MARKER * rng.normal(size=3))
            for link, at in self.markers.values()
        ]
        turns = Rotation.random(max(len(self.stands), 1), rng=rng).as_euler("xyz", degrees=True)
        places = list(self.stands.values()) or [(0.0, 0.0, 0.0)]
        stands = [frame((at, tuple(turn))) for at, turn in zip(places, turns, strict=True)]
        eyes = [np.linalg.inv(displaced(T, _STANDS * rng.normal(size=6))) for T in stands]

        def read(arm: Truth) -> tuple[Array, float]:
            points = [(arm.link(link) @ [*at, 1.0]) for link, at in seats]
            return np.array([(eye @ p)[:3] for eye in eyes for p in points]), 1e-3 * _SIGMA_MM

        return read


@dataclass(frozen=True)
class Eye:
    """A camera and a chessboard, one on a link and one in the world; pitch : mm of a square."""

    on: str
    camera: Standing
    board_on: str
    board: Standing
    pitch: int

    def cell(self) -> str:
        """Tables of a cell."""
        on, board_on = ("world" if own == "world" else "tip" for own in (self.on, self.board_on))
        return (
            f'[boards.board]\non = "{board_on}"\nsquares = [{_ACROSS + 1}, {_DOWN + 1}]\n'
            f'pitch_mm = {self.pitch}\n{_keys(self.board)}[instruments.eye]\nkind = "camera"\n'
            f'on = "{on}"\nfocal_px = {_FOCAL}\ncenter_px = {list(_CENTRE)}\n'
            f"image_px = {list(_IMAGE)}\nsigma_px = {_SIGMA_PX}\n{_keys(self.camera)}"
        )

    def drawn(self, rng: np.random.Generator) -> Callable[[Truth], tuple[Array, float]]:
        """What is exactly read, (C, 2), and its noise, of places that are off."""
        import cv2

        camera, board = (
            displaced(frame(at), _STANDS * rng.normal(size=6)) for at in (self.camera, self.board)
        )
        down, across = np.indices((_DOWN, _ACROSS)).reshape(2, -1)
        corners = 1e-3 * self.pitch * np.column_stack([across + 1, down + 1, np.zeros(len(down))])
        K = np.array([[_FOCAL, 0, _CENTRE[0]], [0, _FOCAL, _CENTRE[1]], [0, 0, 1.0]])
        flat = np.column_stack([corners[:, :2], np.ones(len(corners))])

        def read(arm: Truth) -> tuple[Array, float]:
            eye = arm.link(self.on) @ camera
            T = np.linalg.inv(eye) @ arm.link(self.board_on) @ board
            turn = Rotation.from_matrix(T[:3, :3]).as_rotvec()
            pixels = cv2.projectPoints(corners, turn, T[:3, 3], K, None)[0][:, 0]
            slopes = np.linalg.lstsq(flat, pixels)[0][:2]
            side = 1e-3 * self.pitch * np.linalg.svd(slopes, compute_uv=False)[-1]
            return pixels, _SIGMA_PX * float(np.hypot(1.0, 2.0 * _SMALL / side))

        return read


@dataclass(frozen=True)
class Case:
    """A robot, what reads it, and how many poses are planned; more : further tables of its cell."""

    urdf: Callable[[], str]
    base: str
    tip: str
    reads: Trackers | Eye
    poses: int
    more: str = ""

    def cell(self) -> calib.Cell:
        """The cell, read from its files."""
        head = (
            f'schema = 1\n[robot]\nurdf = "robot.urdf"\nbase = "{self.base}"\ntip = "{self.tip}"\n'
        )
        model = '[model]\neffects = ["base", "tool", "geometry"]\n'
        with TemporaryDirectory() as folder:
            path = Path(folder) / "cell.toml"
            path.with_name("robot.urdf").write_text(self.urdf(), encoding="utf-8")
            path.write_text(head + self.more + self.reads.cell() + model, encoding="utf-8")
            return calib.load_cell(path)


def _kr270() -> str:
    return embedded_text("kr270.urdf")


def _panda() -> str:
    return (data_folder("panda_sockets_2") / "robot.urdf").read_text(encoding="utf-8")


def _justin() -> str:
    """Both public chains as one: the torso once, joints and links of each arm by its side."""
    lines = [
        '<link name="right_side"/><joint name="right_side" type="fixed"><parent link="l3"/><child '
        'link="right_side"/><origin xyz="0 0 0" rpy="0 0 3.141592653589793"/></joint>'
    ]
    for side in ("left", "right"):
        chain = (data_folder("justin") / f"{side}.urdf").read_text(encoding="utf-8").splitlines()
        first = next(i for i, line in enumerate(chain) if 'name="a1"' in line)
        lines[:0] = chain[1:first] if side == "left" else []
        arm = "\n".join(chain[first:-1]).replace('"a', f'"{side}_a')
        arm = re.sub(r'"l(\d+)"', rf'"{side}_l\1"', arm)
        lines.append(arm.replace(f'"{side}_l3"', '"l3"' if side == "left" else '"right_side"'))
    return '<robot name="justin">' + "\n".join(lines) + "</robot>"


def _shapes(radius: int, **ends: Triple) -> str:
    """Capsules along links, mm."""
    lines = (
        f"{joint} = [{{ from = [0, 0, 0], to = {list(end)}, radius = {radius} }}]\n"
        for joint, end in ends.items()
    )
    return "[robot.capsules_mm]\n" + "".join(lines)


_IN_HAND: Standing = ((50, 0, 50), (0, 0, 90))
_DOWN_ON: Triple = (180, 0, 0)
_BALLS: tuple[Triple, ...] = ((279, -16, -92), (279, -25, 96), (282, 130, 6))


def _balls(link: str) -> dict[str, tuple[str, Triple]]:
    return {f"m{k}": (link, at) for k, at in enumerate(_BALLS, 1)}


CASES = {
    "camera in the hand of a UR5": Case(
        lambda: urdf(LIGHT, masses=False), "base", "flange",
        Eye("flange", _IN_HAND, "world", ((-600, 110, 0), _DOWN_ON), 20), 40,
        _shapes(50, lift=(608, 0, 0), elbow=(569, 0, 0)),
    ),
    "camera in the hand of a Panda": Case(
        _panda, "base_link", "tool0",
        Eye("tool0", _IN_HAND, "world", ((500, -110, 0), _DOWN_ON), 20), 40,
    ),
    "camera beside a KR 270": Case(
        _kr270, "base_link", "tool0",
        Eye("world", ((3800, 0, 1800), (-90, 0, 90)), "tool0", ((50, -180, -240), (0, -90, 0)), 40), 40,
        _shapes(150, A2=(1350, 0, 0)),
    ),
    "two trackers, KR 270": Case(
        _kr270, "base_link", "tool0",
        Trackers(
            _balls("tool0"),
            {"left": (3000, 3000, 500), "right": (3000, -3000, 500)},
        ), 30, _shapes(200, A2=(1350, 0, 0), A3=(0, 0, -41)),
    ),
    "SCARA": Case(
        lambda: urdf(SCARA, masses=False), "base", "flange", Trackers(_balls("flange"), {}), 20,
    ),
    "Justin": Case(
        _justin, "base_link", "right_l10",
        Trackers({"right": ("right_l10", (105, 203, -22)), "left": ("left_l10", (100, 174, 17))}, {}),
        60, "[robot.coupled.t4]\nof = { t2 = -1, t3 = -1 }\n",
    ),
}  # fmt: skip


def executed(name: str, days: int, seed: int) -> Row:
    """One plan and the fits of its days."""
    case = CASES[name]
    cell, rng = case.cell(), np.random.default_rng(seed)
    plan = doe.design(cell, poses=case.poses, candidates=_CANDIDATES, seed=seed)
    model, poses = plan.problem.model, plan.poses
    arm, read = Truth(case.urdf(), rng), case.reads.drawn(rng)
    exact, noise = zip(*(read(at) for at in arm.poses(cell.robot.joints, poses.q)), strict=True)
    seen, sigma = visible(scene_of(cell, poses.q)), np.array(noise)[:, None, None]
    fits = []
    for _ in range(days):
        rows = exact + sigma * rng.normal(size=np.shape(exact))
        data = calib.Measurements(poses, rows * seen[..., None], seen, np.full(seen.shape, np.nan))
        found = calib.identify(cell, data)
        values = dict(zip((p.id for p in found.model.parameters), found.values, strict=True))
        fits.append([values[p.id] for p in model.parameters])
    # Rows turn with the instrument, and the plan does not know where it truly stands.
    mean = np.mean(fits, axis=0)
    rows = target_rows(model, mean, plan.problem.targets)
    missed = np.square(rows @ (np.array(fits) - mean).T).sum(axis=1).T @ plan.problem.target_weights
    scattered = float(np.sqrt(missed.sum() / (days - 1)))
    promised = plan.assessment.task_rms
    return {
        "plan": name,
        "poses": len(poses),
        "hidden [%]": 100.0 * float(1.0 - seen.mean()),
        "proved": plan.efficiency,
        "promised [mm]": promised * 1e3,
        "scattered [mm]": scattered * 1e3,
        "ratio": scattered / promised,
        "its error": float(missed.std() / missed.mean() / 2.0 / np.sqrt(days)),
    }


@bench(several("--only", tuple(CASES)), days=40, days_help="Of each plan.", workers=True)
def main(only: tuple[str, ...], days: int, seed: int, workers: int) -> Output:
    """Carry out plans."""
    found = each(executed, [(name,) for name in only], workers, days=days, seed=seed)
    return [table(found)], {"seed": seed, "days": days, "plans": found}


if __name__ == "__main__":
    main()
