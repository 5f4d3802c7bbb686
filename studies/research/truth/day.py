"""A plain day of three arms with light links: read files, targets, and where the arm goes there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.truth import arms
from studies.research.truth.arms import LIGHT, Arm, Array
from studies.research.truth.files import csv_text, plain_cell
from studies.research.truth.mechanism import Action, Mechanism, State, urdf
from studies.research.truth.noise import Scatter, scatter_of
from studies.research.truth.scene import reflectors
from studies.research.truth.session import as_shown

SIGMA = 10e-6  # m, of one coordinate of the instrument
TARGETS = 200
_NEAR_HALF_A_TURN = 3.0  # rad: beyond, one placement has two rotation vectors


def _limited(arm: Arm, *degrees: float, tool: float) -> Arm:
    """The arm with other limits for each joint that turns, light and without drives that yield."""
    limits, joints = iter(np.radians(degrees).tolist()), []
    for joint in arm.joints:
        if not joint.slides:
            limit = next(limits)
            joint = replace(joint, low=-limit, high=limit, mass=3.0, com=(0.0, 0.0, 0.1))
        joints.append(replace(joint, compliance=0.0))
    light = replace(arm, load=0.0, payload=0.0, largest=1e-3)
    return replace(light, joints=tuple(joints), sigma=SIGMA, tool=tool)


SEVEN = _limited(arms.SEVEN, 170, 120, 170, 120, 170, 120, 175, tool=0.15)
SCARA = _limited(arms.SCARA, 130, 140, 360, tool=0.10)
ARMS = {"6R": LIGHT, "7R": SEVEN, "SCARA": SCARA}
Truth = Callable[[Array], Array]
"""Where joints (N, n) truly are that are read."""


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

    twist : of hours (N,) the displacement (N, 6) of the base, along and about its axes, m and rad
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

    def then(self, count: int) -> Array:
        """How far the base has moved by the time of the targets, shape (N, 6)."""
        return self.twist(np.full(count, self.session + self.later))


@dataclass(frozen=True, eq=False)
class Day:
    """The true arm of one day and what was read.

    mechanism, truth : the arm, and where joints truly are that are read; scatter : of the arm
    markers, guesses : ndarray, shape (M, 3), m, true and as the cell has them
    R, p : placement of the base in the instrument's frame
    names : of the readings; q : ndarray, shape (N, n), rad or m, in order
    exact, read : ndarray, shape (N, M, 3), m, without scatter and noise, and as measured
    targets : ndarray, shape (T, n); reached, approached : ndarray, shape (T, M, 3), m, where the arm
        is at them without scatter, and where one approach of each takes it
    floor : Floor or None, where the base keeps still
    """

    arm: Arm
    mechanism: Mechanism
    truth: Truth
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
        moved = None if self.floor is None else self.floor.then(len(q))
        there = standing(self.mechanism, self.truth(q), self.R, self.p, self.scatter, rng, moved)
        return there.readings

    def nominal(self, q: Array, markers: Array, R: Array, p: Array) -> Array:
        """Where the arm of its file has markers (M, 3) at joints (N, n), base placed at R, p."""
        arm = Mechanism(self.arm, np.zeros((self.arm.dof + 2, 6)), markers, weighs=False)
        return standing(arm, q, R, p).readings


def draw_day(
    setting: Setting,
    index: int,
    seed: int,
    truth: Truth = np.copy,
    floor: Floor | None = None,
) -> Day:
    """One day; even ones scatter in the joints, odd ones at the tip.

    truth : where joints (N, n) truly are that are read; floor : under a base that moves
    """
    arm = ARMS[setting.arm]
    numbers = (setting.scatter * 1e6, setting.approaches, setting.poses, setting.markers)
    which = [seed, index, list(ARMS).index(setting.arm), *(round(v) for v in numbers)]
    rng = np.random.default_rng(which)
    geometry = rng.normal(size=(arm.dof + 2, 6)) * np.repeat([3e-4, 4e-4], 3)
    guesses = reflectors(rng, arm, setting.markers, (0.4, 0.7), (0.5, 1.1))
    markers = guesses + rng.normal(size=guesses.shape) * 1e-3
    R, p = _placement(rng)
    visits = _visits(rng, setting.poses, setting.approaches)
    q = _joints(rng, arm, setting.poses)[visits]
    targets = _joints(rng, arm, TARGETS)
    mechanism = Mechanism(arm, geometry, markers, weighs=False)
    now = None if floor is None else floor.twist(floor.during(len(q)))
    then = None if floor is None else floor.then(TARGETS)
    still = standing(mechanism, truth(q), R, p, moved=now)
    shape = scatter_of(rng, arm, still, in_joints=index % 2 == 0)
    scatter = shape.times(setting.scatter / shape.at_tip(arm, still))
    came = standing(mechanism, truth(q), R, p, scatter, rng, now).readings
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
        read=came + rng.normal(size=came.shape) * SIGMA,
        targets=targets,
        reached=standing(mechanism, truth(targets), R, p, moved=then).readings,
        approached=standing(mechanism, truth(targets), R, p, scatter, rng, then).readings,
        floor=floor,
    )


def standing(
    mechanism: Mechanism,
    q: Array,
    R: Array,
    p: Array,
    scatter: Scatter | None = None,
    rng: np.random.Generator | None = None,
    moved: Array | None = None,
    act: Callable[[Action, State], None] = lambda action, state: None,
) -> State:
    """The weightless arm at joints, each approached once where it scatters.

    moved : ndarray, shape (N, 6), displacement of its base; act : writes what else there is
    """
    wander = None
    if scatter is not None and rng is not None:
        wander = scatter.drawn(rng, np.arange(len(q)))

    def acting(state: State) -> Action:
        action = Action.none(mechanism.arm, len(q), len(mechanism.markers))
        act(action, state)
        if moved is not None:
            action.twist[:, 0] += moved
        if wander is not None:
            wander.add_to(action, None, None)
        return action

    return mechanism.rest(q, acting, (R, p))


def _placement(rng: np.random.Generator) -> tuple[Array, Array]:
    """Rotation, shape (3, 3), and position, shape (3,), m, 2 to 5 m from the instrument."""
    while True:
        turn = Rotation.random(rng=rng)
        if turn.magnitude() < _NEAR_HALF_A_TURN:
            away = rng.normal(size=3)
            return turn.as_matrix(), rng.uniform(2.0, 5.0) * away / np.linalg.norm(away)


def _joints(rng: np.random.Generator, arm: Arm, count: int) -> Array:
    """Anywhere within the limits, rounded as the files show them."""
    low, high = arm.limits.T
    drawn = low + rng.random((count, arm.dof)) * (high - low)
    return np.asarray(np.clip(as_shown(arm, drawn), low, high))


def _visits(rng: np.random.Generator, poses: int, approaches: int) -> Array:
    """Rounds over all poses, each in an order of its own, never the same pose twice in a row."""
    while True:
        order = np.concatenate([rng.permutation(poses) for _ in range(approaches)])
        if np.all(np.diff(order)):
            return order


Columns: TypeAlias = Sequence[tuple[str, float]]
"""Columns of a table, each of one value."""


def write_day(
    folder: Path, day: Day, robot: Sequence[str] = (), read: Columns = (), asked: Columns = ()
) -> None:
    """The files that a user brings, targets.csv, and exact.csv with what a perfect day had read.

    robot : lines more of that table of the cell; read, asked : columns more of readings and targets
    """
    arm, floor, time, design = day.arm, day.floor, list[str](), ['targets = "targets.csv"']
    if floor is not None:
        time = [f"{h * 3600:.0f}" for h in floor.during(len(day.q))]
        design += [f"targets_after_h = {floor.later:g}"] if floor.told else []
    (names, always), (beside, there) = (
        ([name for name, _ in own], [f"{value:g}" for _, value in own]) for own in (read, asked)
    )
    targets = [[f"t{i}", *_digits(q), *there] for i, q in enumerate(arm.shown(day.targets))]
    texts = {
        "robot.urdf": urdf(arm, masses=False),
        "cell.toml": plain_cell(arm, day.guesses, SIGMA, robot, design),
        "targets.csv": csv_text([["pose", *arm.columns(), *beside], *targets]),
    }
    head = ["pose", "marker", *arm.columns(), "x_mm", "y_mm", "z_mm", *["time_s"][: len(time)]]
    for name, points in (("measurements.csv", day.read), ("exact.csv", day.exact)):
        rows = [
            [day.names[i], f"m{m}", *_digits(q), *_digits(p * 1e3), *time[i : i + 1], *always]
            for i, (q, of_pose) in enumerate(zip(arm.shown(day.q), points, strict=True))
            for m, p in enumerate(of_pose, 1)
        ]
        texts[name] = csv_text([[*head, *names], *rows])
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def _digits(values: Array) -> list[str]:
    return [f"{v:.7f}" for v in values]
