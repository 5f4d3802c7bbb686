"""A day: its arm and scene, true causes sized by noncentrality, files, and what the diagnosis says."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

import calib
from studies.diagnose.make import findings
from studies.research.benchmarks.day import SCARA, SEVEN, placement
from studies.research.withheld.draw import EASY, Case
from studies.research.withheld.judge import Entry
from studies.research.withheld.keys import write_case
from studies.research.withheld.robots import HEAVY, LIGHT, RAIL, Arm, Array, Joint, Triple
from studies.research.withheld.scene import Noise, Scatter, Scene, scatter_of
from studies.research.withheld.session import Session, approaches
from studies.research.withheld.truth import Action, Mechanism, State
from studies.research.withheld.visible import Projector, at_rest


def _turning(
    name: str, xyz: Triple, axis: Triple, degrees: tuple[float, float], mass: float, com: Triple
) -> Joint:
    low, high = np.radians(degrees)
    return Joint(name, xyz, axis, float(low), float(high), mass, com)


UR_ON_TRACK = Arm(
    "ur_on_track",
    "rail",
    "tool0",
    (
        Joint("track", (0, 0, 0.30), (0, 1, 0), -1.0, 1.0, 40.0, (0, 0, 0.05), slides=True),
        _turning("shoulder_pan", (0, 0, 0.1273), (0, 0, 1), (-180, 180), 7.8, (0, 0.02, 0)),
        _turning("shoulder_lift", (0, 0.2209, 0), (0, 1, 0), (-175, -5), 12.9, (0.31, 0, 0)),
        _turning("elbow", (0.612, -0.1719, 0), (0, 1, 0), (-150, 150), 3.9, (0.29, 0, 0)),
        _turning("wrist_1", (0.5723, 0, 0), (0, 1, 0), (-180, 180), 2.0, (0, 0.01, 0)),
        _turning("wrist_2", (0, 0.1149, 0), (0, 0, -1), (-180, 180), 2.0, (0, 0.01, 0)),
        _turning("wrist_3", (0, 0, -0.1157), (0, 1, 0), (-180, 180), 0.4, (0, 0.02, 0)),
    ),
    (0, 0.0922, 0),
    (-1.570796, 0, 0),
    sigma=15e-6,
    load=0.0,
    tool=0.12,
    largest=2e-3,
    payload=0.0,
)  # lengths and masses of a UR10

_OPEN = {
    arm.name: replace(arm, spring=None)  # these days have no balancing spring
    for arm in (LIGHT, HEAVY, RAIL, SEVEN, SCARA, UR_ON_TRACK)
}
ARM_KINDS = ("light", "seven", "scara", "heavy")
"""6R of 1.3 m, 7R, SCARA and 6R of 2.7 m."""


def arm_of(name: str) -> Arm:
    """By its name, without a balancing spring."""
    return _OPEN[name]


Act = Callable[[Scene, State], Action]


@dataclass(frozen=True, eq=False)
class TrueCause:
    """Linear in its size.

    kind : formula; where : place; act : what it does at size one
    names : effects that are the right answer, each as a key of the sealed cases has them
    """

    kind: str
    where: str
    act: Act
    names: tuple[Entry, ...]
    size: float = 1.0

    def sized(self, factor: float) -> TrueCause:
        """The same, so many times as large."""
        return replace(self, size=self.size * factor)

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        action.add(self.act(scene, state), np.full(scene.count, self.size))


def named(where: str, *effects: str) -> tuple[Entry, ...]:
    """Effects at one place."""
    return tuple({"effect": effect, "where": where} for effect in effects)


def tuned(entry: Entry, name: str, value: float, unit: str, tolerance: float) -> Entry:
    """The same, right only where a parameter is near enough."""
    near = {"name": name, "value": value, "unit": unit, "tolerance": tolerance}
    return {**entry, "tuned": near}


def joint_error(k: int, dq: Callable[[Scene, State], Array]) -> Act:
    """What turns or shifts joint k by dq, shape (N,), rad or m."""

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        action.joint[:, k] = dq(scene, state)
        return action

    return act


def base_motion(twist: Array, by: Callable[[Scene], Array]) -> Act:
    """What moves the base by a twist (6,), m and rad, times ``by``, shape (N,)."""

    def act(scene: Scene, state: State) -> Action:  # noqa: ARG001
        action = scene.nothing()
        action.twist[:, 0] = np.outer(by(scene), twist)
        return action

    return act


def ripple_names(scene: Scene, k: int, cycles: float) -> tuple[Entry, ...]:
    """A ripple of joint k, found where its cycles are within two widths of a spectral line."""
    line = 2.0 * np.pi / float(np.ptp(scene.session.q[:, k]))
    (entry,) = named(scene.arm.names[k], "gear_ripple")
    return (tuned(entry, "cycles", cycles, "1/turn", 2.0 * line),)


ALL_COLUMNS = frozenset({"time", "temperature", "approach"})
_GEOMETRY = np.repeat([3e-4, 4e-4], 3)  # m and rad, standard deviations of the errors of a frame
_GUESS = 1e-3  # m, by which a coordinate of a marker is guessed wrongly
_PACE = (80.0, 140.0)  # s from reading to reading


def random_poses(rng: np.random.Generator, arm: Arm, count: int, share: float = 1.0) -> Array:
    """Joints anywhere in a share of their ranges, shape (count, n), rad or m."""
    low, high = arm.limits.T
    start = low + rng.random(arm.dof) * (1.0 - share) * (high - low)
    return as_shown(arm, start + rng.random((count, arm.dof)) * share * (high - low))


def as_shown(arm: Arm, q: Array) -> Array:
    """Rounded as the files show them, 1e-6 deg or mm."""
    unit = np.where(arm.slides, 1e-3, np.pi / 180.0)
    return np.asarray(np.round(q / unit, 6) * unit)


def scene_of(
    rng: np.random.Generator,
    arm: Arm,
    q: Array,
    guesses: Array,
    *,
    sigma: float,
    columns: frozenset[str] = ALL_COLUMNS,
    geometry: Array | None = None,
    weighs: bool = True,
) -> Scene:
    """The arm on its day; base, markers and, where it is not given, geometry are drawn."""
    R, p = placement(rng)
    if geometry is None:
        geometry = rng.normal(size=(arm.dof + 2, 6)) * _GEOMETRY
        geometry[0] = 0.0
    turning = [joint.name for joint in arm.joints if not joint.slides]
    return Scene(
        arm=arm,
        session=_session(rng, q),
        geometry=geometry,
        markers=guesses + rng.normal(size=guesses.shape) * _GUESS,
        guesses=guesses,
        compliance=np.zeros(arm.dof),
        modelled=(),
        known_geometry=False,
        weighs=weighs,
        payload=0.0,
        com=np.zeros(3),
        columns=columns,
        knots={},
        noise=Noise.uniform(sigma),
        believed=Noise.uniform(sigma),
        R=R,
        p=p,
        wrench=np.zeros((len(q), 6)),
        ratios={name: int(rng.integers(50, 161)) for name in turning},
    )


def scattering(
    rng: np.random.Generator, scene: Scene, still: State, size: float, in_joints: bool
) -> Scene:
    """The same with an arm that scatters at each approach; size : m, of one coordinate of its tip."""
    if size == 0.0:
        return scene
    shape = scatter_of(rng, scene.arm, still, in_joints)
    factor = size / shape.repeatability(scene.arm, still)[0]
    return with_scatter(scene, shape.times(factor))


def with_scatter(scene: Scene, scatter: Scatter) -> Scene:
    """The same with a scatter that is given."""
    return replace(scene, scatter=scatter)


def _session(rng: np.random.Generator, q: Array) -> Session:
    N = len(q)
    time = np.cumsum(rng.uniform(*_PACE, N)).round(1)
    approach, motion = approaches(rng, q, known_start=True)
    nothing_held: NDArray[np.bool_] = np.zeros(N, dtype=bool)
    return Session(
        names=tuple(f"p{i:03d}" for i in range(N)),
        q=q,
        held=nothing_held,
        force=np.zeros((N, 3)),
        hang=np.zeros(3),
        time=time,
        temperature=_temperature(rng, time),
        approach=approach,
        motion=motion,
    )


def _temperature(rng: np.random.Generator, time: Array) -> Array:
    """A hall in the course of a morning: a swing of some hours beside a rise."""
    hours = (time - time[0]) / 3600.0
    turn = 2.0 * np.pi * (hours / rng.uniform(2.0, 4.0) + rng.random())
    swing, rise = rng.uniform(2.0, 4.0), rng.uniform(-1.0, 1.0)
    return np.asarray(np.round(rng.uniform(19.0, 23.0) + swing * np.sin(turn) + rise * hours, 3))


NONCENTRALITY = (60.0, 3000.0)
VISIBLE = 60.0
_ROUNDS = 4
_NEAR = 0.01


class NoSuchDay(Exception):
    """A cause that would have to be absurdly large to be seen."""


class Visibility:
    """Of causes on one day."""

    def __init__(self, scene: Scene, mechanism: Mechanism, still: State) -> None:
        self._scene, self._mechanism, self._still = scene, mechanism, still
        seen = np.ones(still.readings.shape[:2], dtype=bool)
        self._projector = Projector(scene, still, seen)

    def moved(self, causes: Sequence[TrueCause]) -> Array:
        """Displacement of the readings by some causes, shape (N, M, 3), m."""
        try:
            state = at_rest(self._scene, self._mechanism, causes)
        except RuntimeError as error:
            raise NoSuchDay from error
        return np.asarray(state.readings - self._still.readings)

    def alone(self, cause: TrueCause) -> float:
        """Noncentrality of one cause."""
        rest = self._projector.left(self.moved([cause]))
        return float(rest @ rest)

    def beside(self, causes: Sequence[TrueCause]) -> list[float]:
        """Noncentrality of each where the sizes of all others are free."""
        rests = np.array([self._projector.left(self.moved([cause])) for cause in causes])
        return [_left(rests[i], np.delete(rests, i, axis=0)) for i in range(len(rests))]

    def sized(self, cause: TrueCause, wanted: float) -> TrueCause:
        """A cause of a noncentrality. Raises NoSuchDay."""
        return self.all_sized([cause], wanted)[0]

    def all_sized(self, causes: Sequence[TrueCause], wanted: float) -> list[TrueCause]:
        """Causes scaled alike until all together have a noncentrality. Raises NoSuchDay."""
        found = list(causes)
        for _ in range(_ROUNDS):
            moved = self.moved(found)
            rest = self._projector.left(moved)
            factor = float(np.sqrt(wanted / max(float(rest @ rest), 1e-12)))
            size = float(np.sqrt(np.mean(np.sum(moved**2, axis=-1))))
            if factor * size > self._scene.arm.largest:
                raise NoSuchDay
            if abs(factor - 1.0) < _NEAR:
                return found
            found = [one.sized(factor) for one in found]
        raise NoSuchDay


def drawn_noncentrality(
    rng: np.random.Generator, within: tuple[float, float] = NONCENTRALITY
) -> float:
    """Evenly in its logarithm."""
    return float(np.exp(rng.uniform(*np.log(within))))


def _left(rest: Array, others: Array) -> float:
    if len(others):
        rest = rest - others.T @ np.linalg.lstsq(others.T, rest, rcond=None)[0]
    return float(rest @ rest)


Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Day:
    """One day.

    kind : what it is counted as
    causes : of size; noncentrality : of each, beside the others
    family : how many of the causes, the first ones, are one kind at all joints
    ratio : scatter of the arm over noise of the instrument, of one coordinate of the tip
    """

    kind: str
    scene: Scene
    mechanism: Mechanism
    causes: tuple[TrueCause, ...] = ()
    noncentrality: tuple[float, ...] = ()
    family: int = 0
    ratio: float = 0.0
    more: Row = field(default_factory=dict)


def by_turns(
    kinds: Sequence[str], make: Callable[[np.random.Generator, str, bool], Day]
) -> Callable[[np.random.Generator, int], Day]:
    """A draw by number: the kinds take turns, and two days of three the arm scatters.

    make : draws one of a kind, or raises NoSuchDay
    """

    def draw(rng: np.random.Generator, index: int) -> Day:
        kind, scatters = kinds[index % len(kinds)], index // len(kinds) % 3 > 0
        while True:
            try:
                return make(rng, kind, scatters)
            except NoSuchDay:
                continue

    return draw


def read(rng: np.random.Generator, day: Day) -> Case:
    """The day as it is measured: the arm scatters, the instrument errs.

    Raises NoSuchDay where the arm is too soft for its loads.
    """
    scene = day.scene
    wander = [] if scene.scatter is None else [scene.scatter.drawn(rng, scene.session.visit)]
    try:
        state = at_rest(scene, day.mechanism, [*day.causes, *wander])
    except RuntimeError:
        raise NoSuchDay from None
    noise = rng.normal(size=state.readings.shape) * scene.noise.sigma
    return Case(
        family=day.kind,
        conditions=EASY,
        scene=scene,
        causes=(),
        noncentrality=day.noncentrality,
        beside=day.noncentrality,
        together=sum(day.noncentrality),
        state=state,
        clean=state.readings,
        noisy=state.readings + noise,
        seen=np.ones(state.readings.shape[:2], dtype=bool),
    )


def said_of(case: Case) -> Row:
    """The findings as JSON, and the seconds; where the program breaks, how."""
    with TemporaryDirectory() as name:
        folder = Path(name) / "day"
        write_case(folder, case)
        cell = calib.load_cell(folder / "cell.toml")
        data = calib.load_measurements(cell, folder / "measurements.csv")
        begun = time.perf_counter()
        try:
            found = findings(calib.diagnose(cell, data)).model_dump(mode="json", by_alias=True)
        except Exception as error:  # a traceback is a conclusion too, and a wrong one
            found = {"verdict": "failed", "error": f"{type(error).__name__}: {error}"}
    return {**found, "seconds": round(time.perf_counter() - begun, 2)}
