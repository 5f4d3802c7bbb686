"""Days of measurement: a cell, what was read, what was held out, and the truth behind them.

``day`` draws each day once a session. Arms in MuJoCo come from :mod:`studies.research`, whose truth
shares no code with the estimator; nothing else of the tests of calib imports from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Diagnosis, Measurements, Poses, readings
from calib.arm.robot import Robot
from calib.arm.statics import wrench_with_load
from calib.arrays import Array
from calib.cell.planned import Planned
from calib.effects.protocol import ElasticEffect
from calib.model import Model
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from studies.demo.embedded import embedded_cell
from studies.research.bench import real_data
from studies.research.sealed.draw import Case
from studies.research.sealed.key import write_case
from studies.research.sealed.visible import Projector
from studies.research.sealed.weights import chance as name_chance
from studies.research.sealed.weights import fitted as name_weights
from studies.research.truth.arms import ARMS, HEAVY, LIGHT, SCARA, SEVEN, Arm
from studies.research.truth.conditions import Conditions
from studies.research.truth.day import SEVEN as LIMITED_SEVEN
from studies.research.truth.day import Floor, Setting, draw_day, write_day
from studies.research.truth.files import csv_text, plain_cell
from studies.research.truth.formulas import turned
from studies.research.truth.mechanism import Action, Mechanism, State, urdf
from studies.research.truth.scene import Scene, at_rest, draw_scene
from tests.helpers import cell_of, read_by, with_effects

__all__ = [
    "HEAVY", "LIGHT", "LIMITED_SEVEN", "SCARA", "SEVEN", "Arm", "Floor", "Mechanism", "name_chance",
    "name_weights", "real_data",
]  # fmt: skip

Sizes = float | tuple[float, ...]
_FOLDER = TemporaryDirectory()


class Day(NamedTuple):
    """truth : the values of the model that drew the readings, or the arm in MuJoCo."""

    cell: Cell
    data: Measurements
    heldout: Measurements | None
    truth: Any


@cache
def day(
    arm: str = "kr270", cause: str = "", size: Sizes = 0.0, instrument: str = "tracker",
    noise: float = 1.0, seed: int = 0, **more: Any,
) -> Day:  # fmt: skip
    """A day of an arm with one cause of error that its cell does not know, once a session.

    arm : kr270, simulated by the catalogue; light, heavy or rail, sealed scenes in MuJoCo; 6R, 7R or
        SCARA, weightless arms in MuJoCo
    cause, size : an effect and its values; in a sealed scene a name of ``CAUSES`` and how visible it is
        (noncentrality)
    instrument : tracker, or a scene of :mod:`tests.instrument_days`, whose causes are its faults
    noise : of the readings, over what the cell states
    more : of the session, see each kind of day
    """
    if instrument != "tracker":
        from tests.instrument_days import SCENES

        return SCENES[instrument](_folder(), cause, size, seed)
    if arm == "kr270":
        return _of_the_catalogue(cause, size, noise, seed, **more)
    if arm in {own.name for own in ARMS}:
        return _sealed(arm, cause, size, seed, **more)
    return _exact(arm, seed, **more)


@cache
def diagnosed(cause: str, size: Sizes, seed: int, arm: str = "kr270", **more: Any) -> Diagnosis:
    """The diagnosis of a day, once for all tests that ask about it."""
    cell, data, heldout, _ = day(arm, cause, size, seed=seed, **more)
    return calib.diagnose(cell, data, heldout=heldout)


def once_a_turn(q: Array) -> Array:
    """Where joints truly are of which the third errs by 0.3 mrad once a turn."""
    return q + 3e-4 * np.cos(q[:, [2]]) * (np.arange(q.shape[1]) == 2)


SMALL: Mapping[str, Any] = {"index": 1, "poses": 24, "truth": once_a_turn}
"""A day of 6R that is diagnosed soon, for ``day`` and ``diagnosed``."""


def _folder() -> Path:
    """A new folder that lasts as long as the session."""
    path = Path(_FOLDER.name) / f"day{len(list(Path(_FOLDER.name).iterdir()))}"
    path.mkdir()
    return path


# -- Arms simulated by a cell's own model and one effect more

MODEL = ("base", "tool", "geometry", "joint_compliance:A2,A3,A4,A5,A6")
CONFIGURATIONS = 30


def _of_the_catalogue(effect: str, size: Sizes, noise: float, seed: int, twice: int = 0) -> Day:
    """Thirty configurations of a KR 270, free and loaded, and ten held out; geometry and drives err.

    twice : of the first poses that are read two times
    """
    rng = np.random.default_rng(seed)
    cell = replace(with_effects(embedded_cell(), *MODEL), load=None)
    poses = free_and_loaded(rng, cell, CONFIGURATIONS + 10)
    model = build(with_effects(cell, *MODEL, *([effect] if effect else [])), poses).model
    truth = np.zeros(len(model.parameters))
    for i, p in enumerate(model.parameters):
        if p.effect == "geometry":
            truth[i] = rng.normal() * 3e-4
        elif p.effect == "joint_compliance":
            truth[i] = rng.uniform(0.3, 3.0) * 1e-6
    truth[[p.effect == effect.split(":")[0] for p in model.parameters]] = size
    index = np.sort(np.concatenate([np.arange(len(poses)), np.arange(twice)]))
    names = tuple(f"r{i:03d}" for i in range(len(index)))
    data = drawn_readings(model, truth, replace(poses.take(index), names=names), cell.noise, rng)
    kept = index < 2 * CONFIGURATIONS
    stated = read_by(type(cell.noise).isotropic(cell.noise.across / noise))
    cell = cell if noise == 1.0 else replace(cell, instruments=stated)
    return Day(cell, data.take(kept), data.take(~kept), truth)


def free_and_loaded(rng: np.random.Generator, cell: Cell, count: int) -> Poses:
    """Configurations in the order of measurement, a reading a minute."""
    q = np.repeat(anywhere(cell, rng, count).q, 2, axis=0)
    return with_moves(
        poses_at(
            q,
            time=np.arange(2.0 * count) * 60.0,
            temperature=20.0 + 3.0 * np.sin(np.arange(2.0 * count) / 9.0),
            load_mass=np.tile([0.0, 200.0], count),
            load_com=np.array([0.3, 0.0, 0.15]),
        )
    )


def anywhere(cell: Cell, rng: np.random.Generator, count: int, **given: object) -> Poses:
    """Configurations anywhere in the joint box."""
    low, high = cell.robot.sample_limits().T
    return poses_at(rng.uniform(low, high, (count, cell.robot.dof)), **given)


def valued(model: Model, **kinds: object) -> Array:
    """Values of a model, zero but for the parameters of these effects."""
    values = np.zeros(len(model.parameters))
    for kind, own in kinds.items():
        values[[p.effect == kind for p in model.parameters]] = own
    return values


def read_of(
    cell: Cell, poses: Poses, rng: np.random.Generator, *effects: str, noise: float = 1e-5,
    **kinds: object,
) -> Measurements:  # fmt: skip
    """Readings of the cell's arm with further effects, of which some have values."""
    model = build(with_effects(cell, *cell.effects, *effects), poses).model
    return drawn_readings(model, valued(model, **kinds), poses, Noise.isotropic(noise), rng)


def erring(
    cell: Cell, poses: Poses, rng: np.random.Generator, size: float = 1.0, noise: float = 1e-5
) -> tuple[Measurements, Array]:
    """Data of a random truth: base anywhere, geometry of some sizes, markers far from the guess."""
    model = build(cell, poses).model
    truth = model.sizes * rng.normal(size=len(model.parameters)) * size
    for effect, part in model.parts:
        if effect.kind == "base":
            axis = rng.normal(size=3)
            turn = axis / np.linalg.norm(axis) * rng.uniform(0, np.pi)
            truth[part] = np.concatenate([rng.uniform(-8, 8, 3), turn])
        if effect.kind == "tool":
            truth[part] = rng.uniform(-0.2, 0.2, len(effect.parameters))
        if "compliance" in effect.kind or effect.kind == "stiffness_vs_angle":
            truth[part] = np.abs(truth[part]) + model.sizes[part]
    return drawn_readings(model, truth, poses, Noise.isotropic(noise), rng), truth


RIGID = ("base", "tool", "geometry")
ON_TOOL = np.array(
    [[0.2792, -0.0164, -0.0919], [0.2792, -0.0252, 0.0961], [0.2818, 0.1305, 0.0056]]
)


def rigid_day(
    robot: Robot, seed: int, count: int, markers: Array | int = 3, size: float = 1.0
) -> tuple[Cell, Measurements, Array, np.random.Generator]:
    """A rigid arm anywhere, its truth, and the draws to go on with."""
    rng = np.random.default_rng(seed)
    markers = np.zeros((markers, 3)) if isinstance(markers, int) else markers
    cell = cell_of(robot, markers, RIGID)
    return cell, *erring(cell, anywhere(cell, rng, count), rng, size), rng


# -- The paper's plan, free and loaded, of which a part may be read

PLAN_RIGID = ("base", "tool", "joint_offset:A2,A3")
PLAN_MODEL = (*PLAN_RIGID, "joint_compliance:A2,A3,A4,A5,A6")


def cell_of_day(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, *PLAN_MODEL), design=Planned())


def whole_day(cell: Cell, plan: Poses, seed: int = 1, louder: float = 1.0) -> Measurements:
    """Every reading of the plan, free then loaded, ten minutes apart, loads as wrenches."""
    poses = readings(cell, plan)
    poses = replace(
        poses,
        wrench=wrench_with_load(cell.robot, cell.gravity, poses),
        load_mass=np.zeros(len(poses)),
        time=600.0 * np.arange(len(poses)),
        approach=None,
    )
    poses = with_moves(poses)
    model = build(cell, poses).model
    values = np.zeros(len(model.parameters))
    values[model.where(ElasticEffect)] = 1e-6
    values[:6] = [2.0, -1.0, 0.5, 0.1, -0.2, 0.7]
    n = cell.noise
    noise = Noise(*(louder * s for s in (n.along, n.across, n.along_per_m, n.across_per_m)))
    return drawn_readings(model, values, poses, noise, np.random.default_rng(seed))


def of_poses(data: Measurements, poses: list[int], count: int) -> Measurements:
    """Free and loaded readings of some poses of the plan, all free ones first."""
    return data.take(np.array([*poses, *(count + i for i in poses)]))


# -- Sealed scenes in MuJoCo, with causes written by hand

Act = Callable[[Scene, State], Action]


def _joint_error(where: str, error: Callable[[Scene, int], Array]) -> Act:
    """A joint that is off by an error [rad or m] of shape (N,)."""
    return lambda scene, _: turned(scene, where, error(scene, scene.arm.names.index(where)))


def _heavier(scene: Scene, state: State) -> Action:
    """The hung load is a little heavier than the table's wrench says."""
    action = scene.nothing()
    action.load[:, -1] += 0.06 * scene.wrench
    return action


CAUSES: dict[str, Act] = {
    # A servo read before it was at rest lacks a part of its last move.
    "settling:elbow": _joint_error(
        "elbow", lambda s, k: -1e-4 * s.session.approach[:, k] * s.session.motion[:, k]
    ),
    # The side from which the joint came, whatever the move.
    "backlash:elbow": _joint_error("elbow", lambda s, k: 1e-4 * s.session.approach[:, k]),
    "payload:payload": _heavier,
}


@dataclass(frozen=True)
class _Sized:
    """Anything that moves the arm, so many times."""

    act: Act
    size: float = 1.0

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        action.add(self.act(scene, state), np.full(scene.count, self.size))


def _sealed(arm: str, cause: str, size: Sizes, seed: int, payload: bool = True) -> Day:
    """The cause is sized to be so visible beside the model; payload : whether the cell has it."""
    rng, conditions = np.random.default_rng(seed), Conditions(payload=payload)
    scene = draw_scene(rng, next(a for a in ARMS if a.name == arm), conditions)
    mechanism, truth = scene.mechanism(), _Sized(CAUSES[cause])
    seen = np.ones((scene.count, len(scene.markers)), dtype=bool)
    still = at_rest(scene, mechanism, ())
    projector = Projector(scene, still, seen & ~scene.session.held[:, None])
    for _ in range(3):
        state = at_rest(scene, mechanism, [truth])  # type: ignore[list-item]
        left = projector.left(state.readings - still.readings)
        truth = replace(truth, size=truth.size * float(size / (left @ left)) ** 0.5)
    normal = rng.normal(size=state.readings.shape)
    noisy = state.readings + scene.noise.coloured(normal, state.readings)
    case = Case(
        "single", scene, (), (), (), size, state, state.readings, noisy, seen
    )  # fmt: skip
    folder = _folder() / "day"
    write_case(folder, case)
    cell = calib.load_cell(folder / "cell.toml")
    tables = (folder / name for name in ("measurements.csv", "heldout.csv"))
    return Day(cell, *(calib.load_measurements(cell, table) for table in tables), case)


# -- Weightless arms in MuJoCo, with targets


def _exact(
    arm: str, seed: int, index: int, scatter: float = 0.0, approaches: int = 1, poses: int = 30,
    markers: int = 3, truth: Callable[[Array], Array] = np.copy, floor: Floor | None = None,
    robot: str = "",
) -> Day:  # fmt: skip
    """What is held out was read exactly, and ``targets.csv`` stands beside the cell.

    scatter : m, 3-D RMS of the tip from approach to approach; truth, floor : see ``draw_day``
    robot : lines more of [robot]
    """
    folder = _folder()
    drawn = draw_day(Setting(arm, scatter, approaches, poses, markers), index, seed, truth, floor)
    write_day(folder, drawn, robot.splitlines())
    cell = calib.load_cell(folder / "cell.toml")
    tables = (folder / name for name in ("measurements.csv", "exact.csv"))
    return Day(cell, *(calib.load_measurements(cell, table) for table in tables), drawn)


# -- Files of a user who made a mistake


MARKERS = np.array([[0.07, -0.02, 0.05], [-0.05, 0.06, 0.03], [-0.02, -0.08, 0.09]])


@dataclass(frozen=True, eq=False)
class FileDay:
    """What the user's files hold: joints (m, n) and points (m, M, 3) as columns, SI until a mistake.

    units : of the columns of angles, slides, points; effects : the model
    place : R (3, 3) and p (3,), m, of the base in the instrument's frame
    """

    arm: Arm
    q: Array
    points: Array
    units: tuple[str, str, str] = ("deg", "mm", "mm")
    effects: Sequence[str] = ("base", "tool", "geometry")
    markers: Array = field(default_factory=MARKERS.copy)
    place: tuple[Array, Array] = (np.eye(3), np.zeros(3))

    def written(self, folder: Path) -> Path:
        """Cell, robot and table in a folder."""
        effects = ", ".join(f'"{effect}"' for effect in self.effects)
        cell = plain_cell(self.arm, self.markers, 2e-5, (), ())
        (folder / "robot.urdf").write_text(urdf(self.arm, masses=False))
        (folder / "cell.toml").write_text(cell.replace('"base", "tool", "geometry"', effects))
        turn, slide, point = self.units
        columns = [f"{j.name}_{slide if j.slides else turn}" for j in self.arm.joints]
        scale = {"deg": 180.0 / np.pi, "rad": 1.0, "mm": 1e3, "m": 1.0}
        q = self.q * [scale[column.rpartition("_")[2]] for column in columns]
        lines = [["pose", "marker", *columns, *(f"{a}_{point}" for a in "xyz")]]
        for i, joints in enumerate(q):
            for j, p in enumerate(self.points[i] * scale[point], 1):
                lines.append([f"p{i:03d}", f"m{j}", *(f"{v:.9f}" for v in (*joints, *p))])
        (folder / "measurements.csv").write_text(csv_text(lines))
        return folder

    def read(self, folder: Path) -> tuple[Cell, Measurements]:
        """The files as the program reads them."""
        cell = calib.load_cell(self.written(folder) / "cell.toml")
        return cell, calib.load_measurements(cell, folder / "measurements.csv")

    def with_points(self, change: Callable[[Array], Array]) -> FileDay:
        return replace(self, points=change(self.points))

    def with_joints(self, change: Callable[[Array], Array]) -> FileDay:
        return replace(self, q=change(self.q))


def file_day(
    arm: Arm = HEAVY, seed: int = 0, poses: int = 50, markers: int = 3, link: float = 0.0
) -> FileDay:
    """An arm with errors of 0.3 mm and 0.4 mrad at every frame, read to 0.02 mm from anywhere.

    link : m, by which one link is longer than its model
    """
    rng = np.random.default_rng(seed)
    geometry = rng.normal(size=(arm.dof + 2, 6)) * np.repeat([3e-4, 4e-4], 3)
    along = rng.normal(size=3)
    geometry[rng.integers(2, arm.dof + 1), :3] += link * along / np.linalg.norm(along)
    low, high = arm.limits.T
    q = rng.uniform(low, high, (poses, arm.dof))
    true = MARKERS[:markers] + rng.normal(size=(markers, 3)) * 3e-3
    points = Mechanism(arm, geometry, true, weighs=False).posed(q).points
    R = Rotation.random(random_state=rng).as_matrix()
    p = rng.uniform(-3.0, 3.0, 3)
    points = points @ R.T + p + rng.normal(size=points.shape) * 2e-5
    return FileDay(arm, q, points, markers=MARKERS[:markers], place=(R, p))
