"""Where the arm's base stands in the instrument's frame, drawn at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from studies.research.withheld import robots
from studies.research.withheld.robots import LIGHT, Arm
from studies.research.withheld.scene import Scatter, scatter_of
from studies.research.withheld.tables import csv_text
from studies.research.withheld.truth import Action, Mechanism, State, urdf

_NEAR_HALF_A_TURN = 3.0  # rad: beyond, one placement has two rotation vectors


def placement(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation, shape (3, 3), and position, shape (3,), m, 2 to 5 m from the instrument."""
    while True:
        turn = Rotation.random(rng=rng)
        if turn.magnitude() < _NEAR_HALF_A_TURN:
            away = rng.normal(size=3)
            return turn.as_matrix(), rng.uniform(2.0, 5.0) * away / np.linalg.norm(away)


SIGMA = 10e-6  # m, of one coordinate of the instrument
TARGETS = 200


def _limited(arm: Arm, *degrees: float, tool: float) -> Arm:
    """The arm with limits of its own for each joint that turns, light and without drives that yield."""
    own, joints = iter(np.radians(degrees).tolist()), []
    for joint in arm.joints:
        if not joint.slides:
            limit = next(own)
            joint = replace(joint, low=-limit, high=limit, mass=3.0, com=(0.0, 0.0, 0.1))
        joints.append(replace(joint, compliance=0.0))
    return replace(
        arm, joints=tuple(joints), sigma=SIGMA, load=0.0, tool=tool, largest=1e-3, payload=0.0
    )


SEVEN = _limited(robots.SEVEN, 170, 120, 170, 120, 170, 120, 175, tool=0.15)
SCARA = _limited(robots.SCARA, 130, 140, 360, tool=0.10)
ARMS = {"6R": LIGHT, "7R": SEVEN, "SCARA": SCARA}


@dataclass(frozen=True)
class Setting:
    """What days have in common.

    arm : of ``ARMS``; scatter : m, 3-D RMS of the tip from approach to approach
    approaches : of each pose, others between; poses, markers : how many
    """

    arm: str
    scatter: float
    approaches: int
    poses: int
    markers: int


@dataclass(frozen=True)
class Floor:
    """A base that moves with the hours since the first reading.

    twist : of hours (N,) the displacement (N, 6) of the base, along and about its own axes, m and rad
    session, later : h, how long the readings take, and how long after the last one the targets come
    told : whether the cell says so
    """

    twist: Callable[[Array], Array]
    session: float = 1.0
    later: float = 1.0
    told: bool = True

    def during(self, count: int) -> Array:
        """Hours of so many readings, shape (N,), rounded as the files show them."""
        return np.asarray(np.round(np.linspace(0.0, self.session, count) * 3600.0) / 3600.0)


@dataclass(frozen=True, eq=False)
class Day:
    """The true arm of one day and what was read.

    scatter : of the arm; markers, guesses : ndarray, shape (M, 3), m, true and as the cell has them
    R, p : placement of the base in the instrument's frame
    names : of the readings; q : ndarray, shape (N, n), rad or m, in order
    exact, read : ndarray, shape (N, M, 3), m, without scatter and noise, and as measured
    targets : ndarray, shape (T, n); reached, approached : ndarray, shape (T, M, 3), m, where the arm
        stands at them without scatter, and where one approach of each takes it
    mechanism, truth : the arm, and where joints truly stand that are read
    floor : Floor or None, where the base stands still
    """

    arm: Arm
    mechanism: Mechanism
    truth: Callable[[Array], Array]
    scatter: Scatter
    markers: Array
    guesses: Array
    R: Array
    p: Array
    names: tuple[str, ...]
    q: Array
    exact: Array
    read: Array
    targets: Array
    reached: Array
    approached: Array
    floor: Floor | None = None

    def approach(self, q: Array, rng: np.random.Generator) -> Array:
        """Where one more approach of joints (N, n) takes the markers, shape (N, M, 3), m."""
        place, moved = (self.R, self.p), _moved(self.floor, None, len(q))
        return standing(self.mechanism, self.truth(q), *place, self.scatter, rng, moved).readings

    def nominal(self, q: Array, markers: Array, R: Array, p: Array) -> Array:
        """Where the arm of its file has markers (M, 3) at joints (N, n), base placed at R, p."""
        arm = Mechanism(self.arm, np.zeros((self.arm.dof + 2, 6)), markers, weighs=False)
        return standing(arm, q, R, p).readings


def draw_day(
    setting: Setting,
    index: int,
    seed: int,
    truth: Callable[[Array], Array] = np.copy,
    floor: Floor | None = None,
) -> Day:
    """One day; even ones scatter in the joints, odd ones at the tip.

    truth : where joints (N, n) truly stand that are read; floor : under a base that moves
    """
    arm = ARMS[setting.arm]
    numbers = (setting.scatter * 1e6, setting.approaches, setting.poses, setting.markers)
    which = [seed, index, list(ARMS).index(setting.arm), *(round(v) for v in numbers)]
    rng = np.random.default_rng(which)
    geometry = rng.normal(size=(arm.dof + 2, 6)) * np.repeat([3e-4, 4e-4], 3)
    guesses = reflectors(rng, arm, setting.markers)
    markers = guesses + rng.normal(size=guesses.shape) * 1e-3
    R, p = placement(rng)
    visits = _visits(rng, setting.poses, setting.approaches)
    q = _joints(rng, arm, setting.poses)[visits]
    targets = _joints(rng, arm, TARGETS)
    mechanism = Mechanism(arm, geometry, markers, weighs=False)
    hours = None if floor is None else floor.during(len(q))
    now, then = _moved(floor, hours, len(q)), _moved(floor, None, len(targets))
    still = standing(mechanism, truth(q), R, p, moved=now)
    there = standing(mechanism, truth(targets), R, p, moved=then)
    scatter = _scatter(rng, arm, still, setting.scatter, in_joints=index % 2 == 0)
    stood = standing(mechanism, truth(q), R, p, scatter, rng, now).readings
    return Day(
        arm=arm,
        mechanism=mechanism,
        truth=truth,
        scatter=scatter,
        markers=markers,
        guesses=guesses,
        R=R,
        p=p,
        names=tuple(f"p{k:03d}_{i:03d}" for i, k in enumerate(visits)),
        q=q,
        exact=still.readings,
        read=stood + rng.normal(size=stood.shape) * SIGMA,
        targets=targets,
        reached=there.readings,
        approached=standing(mechanism, truth(targets), R, p, scatter, rng, then).readings,
        floor=floor,
    )


def _moved(floor: Floor | None, hours: Array | None, count: int) -> Array:
    """Displacement (N, 6) of the base at hours (N,), or at the targets' time."""
    if floor is None:
        return np.zeros((count, 6))
    return floor.twist(np.full(count, floor.session + floor.later) if hours is None else hours)


def standing(
    mechanism: Mechanism,
    q: Array,
    R: Array,
    p: Array,
    scatter: Scatter | None = None,
    rng: np.random.Generator | None = None,
    moved: Array | None = None,
) -> State:
    """The weightless arm at joints, each approached once where it scatters.

    moved : ndarray, shape (N, 6), displacement of its base
    """
    action = Action.none(mechanism.arm, len(q), len(mechanism.markers))
    if moved is not None:
        action.twist[:, 0] += moved
    if scatter is not None and rng is not None:
        scatter.drawn(rng, np.arange(len(q))).add_to(action, None, None)
    return mechanism.rest(q, lambda _: action, (R, p))


def _scatter(
    rng: np.random.Generator, arm: Arm, still: State, size: float, in_joints: bool
) -> Scatter:
    shape = scatter_of(rng, arm, still, in_joints)
    at_tip = replace(still, points=still.o[:, -1:])
    return shape.times(size / float(np.sqrt(np.mean(shape.squares(arm, at_tip)))))


def reflectors(rng: np.random.Generator, arm: Arm, count: int = 3) -> Array:
    """Reflectors about the tool at uneven heights, m, as the cell shows them, shape (count, 3)."""
    turn = rng.uniform(0, 2 * np.pi) + np.arange(count) * 2 * np.pi / count
    across = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.4, 0.7)
    along = rng.uniform(0.5, 1.1, (count, 1))
    return np.asarray(np.round(np.hstack([across, along]) * arm.tool, 4))


def _joints(rng: np.random.Generator, arm: Arm, count: int) -> Array:
    """Anywhere within the limits, rounded as the files show them."""
    low, high = arm.limits.T
    unit = np.where(arm.slides, 1e-3, np.pi / 180.0)
    drawn = low + rng.random((count, arm.dof)) * (high - low)
    return np.asarray(np.clip(np.round(drawn / unit, 6) * unit, low, high))


def _visits(rng: np.random.Generator, poses: int, approaches: int) -> Array:
    """Rounds over all poses, each in an order of its own, never the same pose twice in a row."""
    while True:
        order = np.concatenate([rng.permutation(poses) for _ in range(approaches)])
        if np.all(np.diff(order)):
            return order


def write_day(folder: Path, day: Day) -> None:
    """The files that a user brings, targets.csv, and exact.csv with what a perfect day had read."""
    shown = np.where(day.arm.slides, day.q * 1e3, np.degrees(day.q))
    aims = np.where(day.arm.slides, day.targets * 1e3, np.degrees(day.targets))
    joints = [f"{j.name}_{'mm' if j.slides else 'deg'}" for j in day.arm.joints]
    (folder / "robot.urdf").write_text(urdf(day.arm, masses=False), encoding="utf-8")
    design = ['targets = "targets.csv"']
    if day.floor is not None and day.floor.told:
        design.append(f"targets_after_h = {day.floor.later:g}")
    text = cell_text("a day", day.arm, day.guesses, SIGMA, design)
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    target = [[f"t{i}", *_digits(q)] for i, q in enumerate(aims)]
    _table(folder / "targets.csv", ["pose", *joints], target)
    time = [] if day.floor is None else [f"{h * 3600:.0f}" for h in day.floor.during(len(day.q))]
    head = ["pose", "marker", *joints, "x_mm", "y_mm", "z_mm", *["time_s"][: len(time)]]
    for name, points in (("measurements.csv", day.read), ("exact.csv", day.exact)):
        rows = [
            [pose, f"m{m}", *_digits(q), *_digits(point * 1e3), *time[i : i + 1]]
            for i, (pose, q, own) in enumerate(zip(day.names, shown, points, strict=True))
            for m, point in enumerate(own, 1)
        ]
        _table(folder / name, head, rows)


def cell_text(
    name: str, arm: Arm, guesses: Array, sigma: float, design: Sequence[str] = (),
    model: Sequence[str] = (),
) -> str:  # fmt: skip
    """A cell whose model has base, tool and geometry; design, model : further lines of these."""
    markers = [f"m{i} = {(m * 1e3).round(4).tolist()}" for i, m in enumerate(guesses, 1)]
    lines = ["schema = 1", f'name = "{name}"', "[robot]", 'urdf = "robot.urdf"']
    lines += [f'base = "{arm.base}"', f'tip = "{arm.tip}"', "[markers_mm]", *markers]
    lines += ["[instrument]", f"sigma_mm = {sigma * 1e3:g}"]
    lines += ["[design]", *design] if design else []
    return "\n".join([*lines, "[model]", 'effects = ["base", "tool", "geometry"]', *model, ""])


def _digits(values: Array) -> list[str]:
    return [f"{v:.7f}" for v in values]


def _table(path: Path, head: list[str], rows: list[list[str]]) -> None:
    path.write_text(csv_text([head, *rows]), encoding="utf-8")
