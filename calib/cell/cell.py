"""The measurement cell: robot, markers, instrument, loads, and what the user's model contains."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from calib.arm.robot import Robot, Shapes
from calib.arm.statics import STANDARD_GRAVITY, Payload
from calib.arrays import Array, IntArray
from calib.cell.planned import Load, MotionKeys, Pace, Planned, Repeatability
from calib.errors import CalibError, InputError
from calib.instruments import TRACKER, Channels, Instrument, KnownDistance, Tracker
from calib.noise import Noise

_FINEST, _COARSEST = 1e-7, 5e-3  # m: no instrument of this trade reads better, or worse
_UNSTATED = 1.0  # m, of an instrument of which nothing is said
_NEAREST, _FARTHEST = 2e-3, 20.0  # m: between these lie the markers on a tool
SizePrior: TypeAlias = Literal["estimated", "off"] | Mapping[str, float]
"""Of the sizes of errors: found from the data, not counted, or widths by ``kind_unit``."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Cell:
    """What stands in a measurement cell, and what is asked of it; SI and radians.

        robot = Robot.from_urdf("arm.urdf", base="base_link", tip="tool0")
        cell = Cell(robot, {"m1": (0.1, 0.0, 0.05)}, Tracker(sigma=1e-5), ["base", "tool", "geometry"])

    robot : Robot, limits already narrowed by the cell
    markers : ndarray, shape (M, 3), m, first guesses in the frames of their tips
    marker_names : tuple of str
    instruments : tuple of Instrument
    effects : tuple of str, ``name`` or ``name:where[,where]``: what the user's model contains
    name : str; path : Path of the cell file; without one, how faults name the cell
    marker_normals : ndarray, shape (M, 3), unit vectors in the tip frame, NaN where not given
    marker_acceptance : ndarray, shape (M,), rad, largest angle to the beam, NaN where not given
    gravity : ndarray, shape (3,), m/s^2, base axes
    payload : Payload, carried at every pose; load : Load, hung on for the second reading of a plan
    knots : dict, joint -> ndarray, rad, where ``stiffness_vs_angle`` has coefficients
    anchors : dict, joint -> ndarray, shape (2, 3), m, of a gravity compensator's spring
    shapes : Shapes, those of the robot unless the cell states others
    design : Planned, the [design] table; pace : Pace, the [timing] table
    repeatability : Repeatability, or None where it is to be estimated
    excluded : tuple of str, ``name`` or ``name:where``, causes that this robot cannot have
    gear_ratios : dict, joint -> float, turns of motor or wave generator a turn of the joint
    known_distances : tuple of KnownDistance
    bodies : dict, name -> slice, the markers that are points of it: frames have an origin and the ends
        of two axes, boards all their points
    seats : dict, link -> slice, the three markers that stand for one on which an instrument rides
    size_prior : SizePrior, how large errors usually are: found from the data, said, or not counted
    tolerance : float or None, m, of the distance of every held-out point
    about : dict, what the cell's [report] tells of robot, operator and environment, for the reader
    motion : MotionKeys, what motions are read by
    marker_links : tuple of str, the tip of the robot on which each marker rides; ``robot.tip`` without
    """

    robot: Robot
    markers: Array
    marker_names: tuple[str, ...]
    instruments: tuple[Instrument, ...]
    effects: tuple[str, ...]
    name: str
    marker_normals: Array
    marker_acceptance: Array
    shapes: Shapes
    path: Path = Path("cell")
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    payload: Payload = field(default_factory=Payload)
    load: Load | None = None
    knots: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, Array] = field(default_factory=dict)
    design: Planned = field(default_factory=Planned)
    pace: Pace = field(default_factory=Pace)
    repeatability: Repeatability | None = None
    excluded: tuple[str, ...] = ()
    gear_ratios: Mapping[str, float] = field(default_factory=dict)
    known_distances: tuple[KnownDistance, ...] = ()
    bodies: Mapping[str, slice] = field(default_factory=dict)
    seats: Mapping[str, slice] = field(default_factory=dict)
    size_prior: SizePrior = "estimated"
    tolerance: float | None = None
    about: Mapping[str, str] = field(default_factory=dict)
    motion: MotionKeys = field(default_factory=MotionKeys)
    marker_links: tuple[str, ...] = ()

    def __init__(
        self,
        robot: Robot,
        markers: Array | Mapping[str, Sequence[float]],
        instrument: Instrument | Sequence[Instrument] = TRACKER,
        effects: Sequence[str] = ("base", "tool", "geometry"),
        **more: Any,
    ) -> None:
        """Make a cell of what is known; every further field has a default and is given by its name.

        markers : dict, name -> point (3,), m, in the tip frame; or ndarray, shape (M, 3), m, which are
            named m1, m2 ..
        instrument : what reads them; several in a sequence, each with a ``name`` of its own

        Raises CalibError for what is no robot, no marker, no instrument, or no field. Warns of markers
        and noise that look like millimetres.
        """
        points = _points(robot, markers)
        instruments = (instrument,) if isinstance(instrument, Instrument) else tuple(instrument)
        if wrong := [own for own in instruments if not isinstance(own, Instrument)]:
            raise CalibError(f"instrument: {wrong[0]!r} is none; make one, as Tracker(sigma=1e-5)")
        given: dict[str, Any] = {
            own.name: own.default_factory() if own.default_factory is not MISSING else own.default
            for own in fields(self)
        }
        if unknown := sorted({*more} - {*given}):
            raise CalibError(f"a cell has no {unknown[0]!r}; it has {', '.join(given)}")
        given |= {
            "robot": robot,
            "markers": np.array([*points.values()], dtype=float).reshape(-1, 3),
            "marker_names": tuple(points),
            "instruments": instruments,
            "effects": (effects,) if isinstance(effects, str) else tuple(effects),
            "name": robot.name,
            "marker_normals": np.full((len(points), 3), np.nan),
            "marker_acceptance": np.full(len(points), np.nan),
            "shapes": robot.shapes,
        }
        for name, value in (given | more).items():
            object.__setattr__(self, name, value)
        if "path" not in more:  # of a file it is said beside its data
            noises = (odd_noise(own, finest=0.0) for own in self.instruments)  # exact in a test
            for text in (odd_markers(self.markers), *noises):
                if text:
                    warnings.warn(text, stacklevel=2)

    def __repr__(self) -> str:
        read = ", ".join(f"{own.name} ({own.kind})" for own in self.instruments)
        return (
            f"Cell({self.name!r}: {self.robot!r}\n"
            f"  markers {', '.join(self.marker_names)}; read by {read}\n"
            f"  effects {', '.join(self.effects)})"
        )

    def check_poses(self) -> None:
        """Refuse a cell that serves motions alone. Raises InputError."""
        if not self.instruments:
            what, remedy = (
                "has no [instrument]",
                "add it, as in the cell that `posecal demo` writes",
            )
            raise InputError(self.path, "", what, remedy)
        if not self.effects:
            raise InputError(
                self.path, "model.effects", "names nothing", "write what is identified"
            )

    def with_effects(self, *effects: str) -> Cell:
        """The cell whose model contains these effects as well, ``name`` or ``name:where[,where]``."""
        return replace(self, effects=(*self.effects, *effects))

    @property
    def marker_frames(self) -> IntArray:
        """Frame of the tip on which each marker rides, shape (M,). Raises CalibError for no tip."""
        if not self.marker_links:
            return self.robot.on_tip(len(self.markers))
        for link in self.marker_links:
            if link not in self.robot.tips:
                raise CalibError(
                    f"{link!r} is no tip of the robot; tips are {', '.join(self.robot.tips)}"
                )
        first = self.robot.dof + 1
        return np.array([first + self.robot.tips.index(link) for link in self.marker_links])

    def link_under(self, instrument: Instrument) -> str | None:
        """The link on which an instrument rides; None for one in the world, or that is a body."""
        seats = {own.start: link for link, own in self.seats.items()}
        return None if instrument.seat is None else seats[instrument.seat.start]

    @property
    def named_markers(self) -> tuple[str, ...]:
        """Names of the markers that stand for something on the robot, not for a link alone."""
        under = {i for own in self.seats.values() for i in range(own.start, own.stop)}
        return tuple(name for i, name in enumerate(self.marker_names) if i not in under)

    @property
    def single_markers(self) -> tuple[str, ...]:
        """Names of the markers that are no points of a body or of what an instrument rides on."""
        parts = (*self.bodies.values(), *self.seats.values())
        ridden = {i for own in parts for i in range(own.start, own.stop)}
        return tuple(name for i, name in enumerate(self.marker_names) if i not in ridden)

    @property
    def unseen_joints(self) -> tuple[str, ...]:
        """Joints that carry, of every reading, both what reads and what is read, or neither."""
        if any(own.seat is None for own in self.instruments):
            return ()
        frames, seen = self.marker_frames, np.zeros(self.robot.dof, dtype=bool)
        for own in self.instruments:
            under = self.robot.moving(int(frames[own.seat][0]))
            for frame in np.unique(frames[own.read_of(len(frames))]).tolist():
                seen |= under != self.robot.moving(frame)
        return tuple(np.array(self.robot.joints)[~seen].tolist())

    @property
    def robot_files(self) -> tuple[Path, ...]:
        """The robot's files."""
        return self.robot.source.files

    @property
    def named_files(self) -> tuple[Path, ...]:
        """What the cell names beside the robot: the targets."""
        targets = None if self.design.targets is None else self.design.targets.path
        return () if targets is None else (targets,)

    @property
    def targets_in_words(self) -> str:
        """The targets: where they come from, or what stands for them."""
        own = self.design.targets
        return "200 poses spread over the joint limits" if own is None else str(own.path)

    @property
    def channels(self) -> Channels:
        """What the instruments read, in the order of readings."""
        return Channels(self.instruments, len(self.markers))

    @property
    def channel_names(self) -> tuple[str, ...]:
        """What a table calls the reading of each channel: a marker, a body or a point of a board."""
        return self.channels.names(self.marker_names)

    @property
    def read_names(self) -> tuple[str, ...]:
        """All of these, once each."""
        return tuple(dict.fromkeys(self.channel_names))

    @property
    def tracker(self) -> Tracker:
        """The first instrument that measures points; a blank one where there is none."""
        return next((i for i in self.instruments if isinstance(i, Tracker)), TRACKER)

    @property
    def noise(self) -> Noise:
        """Noise of the tracker's points."""
        return self.tracker.noise

    @property
    def instrument(self) -> Array | None:
        """Where the tracker stands, shape (3,), m, base frame, or None."""
        return self.tracker.position if self.tracker.seat is None else None

    @property
    def scatters(self) -> bool:
        """Whether the arm is known to come to a pose otherwise each time."""
        arm = self.repeatability
        return arm is not None and bool(arm.translation or arm.rotation)


def _points(robot: Robot, markers: Array | Mapping[str, Sequence[float]]) -> dict[str, Array]:
    """Markers by name. Raises CalibError for what is no robot, and for what is no finite point."""
    if not isinstance(robot, Robot):
        raise CalibError(f"robot: {robot!r} is none; read one, as Robot.from_urdf('arm.urdf')")
    if not isinstance(markers, Mapping):
        markers = {f"m{j + 1}": point for j, point in enumerate(np.atleast_1d(markers))}
    points = {name: np.asarray(point, dtype=float) for name, point in markers.items()}
    if any(own.shape != (3,) or not np.isfinite(own).all() for own in points.values()):
        raise CalibError("markers: each is three finite coordinates in metres, in the tip frame")
    return points


# -- numbers that look like another unit's


def odd_noise(instrument: Instrument, finest: float = _FINEST) -> str:
    """What is odd about a standard deviation, below ``finest`` [m] or too large; empty for nothing."""
    sigma = instrument.even
    lengths = instrument.numbers[0].unit == "mm"
    if sigma is None or not lengths or sigma == _UNSTATED or finest <= sigma <= _COARSEST:
        return ""
    meant, factor = ("micrometres", 1.0) if sigma > _COARSEST else ("metres", 1e6)
    return (
        f"a standard deviation of {sigma * 1e3:.4g} mm is that of no instrument: if these are "
        f"{meant}, write {sigma * factor:.4g} mm (Python takes metres)"
    )


def odd_markers(markers: Array) -> str:
    """What is odd about markers (M, 3), m, in their tip's frame; empty where nothing is."""
    away = float(np.linalg.norm(markers, axis=1).max(initial=0.0))
    if 0.0 < away < _NEAREST and len(markers) > 1:
        remedy = "if these are metres, write millimetres"
    elif away > _FARTHEST:
        remedy = "if these are millimetres in Python, write metres"
    else:
        return ""
    return f"the farthest is {away * 1e3:.3g} mm from its link's origin: {remedy}"
