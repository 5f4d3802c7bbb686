"""The measurement cell: robot, markers, instrument, loads, and what the user's model contains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from calib.arm.dh import Convention
from calib.arm.robot import Robot
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell.acceptance import Acceptance
from calib.cell.planned import Planned
from calib.instruments import TRACKER, Channels, Instrument, KnownDistance, Tracker
from calib.noise import Noise
from calib.population.prior import Prior

Form: TypeAlias = Literal["urdf", "mjcf", "dh", "kinematics"]
FORMS: tuple[Form, ...] = get_args(Form)

_SOURCES = {
    "urdf": "URDF",
    "mjcf": "MJCF",
    "dh": "DH table",
    "kinematics": "maker's kinematics file",
}


@dataclass(frozen=True)
class Load:
    """The load of a plan, hung on the tip: mass [kg], point in the tip frame [m], largest tilt of
    the tip's x axis from the horizontal [rad].
    """

    mass: float
    com: tuple[float, float, float]
    max_tilt: float = np.pi / 2


@dataclass(frozen=True)
class Capsule:
    """A cylinder with round ends: from, to and radius in metres, in the frame that carries it."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Shapes:
    """What the robot's own file says of its shape.

    capsules : by carrier; unread : shapes that could not be read, with the reason
    stands_at : float, m, lowest point of the base's shapes in its frame, or None
    """

    capsules: Mapping[str, tuple[Capsule, ...]]
    unread: tuple[str, ...] = ()
    stands_at: float | None = None


@dataclass(frozen=True)
class Repeatability:
    """How the arm scatters from one approach of a pose to the next: one standard deviation of one
    coordinate of the tip [m], and of one component of its rotation [rad].
    """

    translation: float
    rotation: float


SizePrior: TypeAlias = Literal["estimated", "off"] | Mapping[str, float]
"""Of the sizes of errors: found from the data, not counted, or widths by ``kind_unit``."""


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything that a cell file says, in SI and radians.

    path : Path of the cell file
    robot_form : ``urdf``, ``mjcf``, ``dh`` or ``kinematics``, the form of the nominal model
    dh_convention : ``classic`` or ``modified`` where that is ``dh``, else None
    robot_files : tuple of Path, the file of the nominal model, then those that it includes, then
        calibrations of cameras
    robot : Robot, limits already narrowed by the cell
    marker_names : tuple of str
    markers : ndarray, shape (M, 3), m, tip frame
    marker_normals : ndarray, shape (M, 3), unit vectors in the tip frame, NaN where not given
    marker_acceptance : ndarray, shape (M,), rad, largest angle to the beam, NaN where not given
    instruments : tuple of Instrument
    gravity : ndarray, shape (3,), m/s^2, base axes
    effects : tuple of str, ``name`` or ``name:where[,where]``
    knots : dict, joint -> ndarray, rad
    anchors : dict, joint -> ndarray, shape (2, 3), m, of a gravity compensator's spring
    capsules : dict, joint name or ``base`` or ``tool`` -> tuple of Capsule
    unread : tuple of str, shapes of the robot's file that could not be read, with the reason
    own_shapes : whether the capsules are those of the robot's file, and none of the cell's
    stands_at : float, m, where the shape of the base ends below, base frame; None where nobody says
    design : Planned, the [design] table
    repeatability : Repeatability, or None where it is to be estimated
    excluded : tuple of str, ``name`` or ``name:where``, causes that this robot cannot have
    gear_ratios : dict, joint -> float, turns of motor or wave generator a turn of the joint
    known_distances : tuple of KnownDistance
    bodies : dict, name -> slice, the markers that are points of it: frames have an origin and the ends
        of two axes, boards all their points
    prior : Prior or None, what the robot's type says of it; prior_file : Path or None, where it stands
    size_prior : SizePrior, how large errors usually are: found from the data, said, or not counted
    acceptance : Acceptance, or None without a tolerance
    about : dict, what the cell's [report] tells of robot, operator and environment, for the reader
    """

    name: str
    path: Path
    robot_form: Form
    robot_files: tuple[Path, ...]
    robot: Robot
    marker_names: tuple[str, ...]
    markers: Array
    marker_normals: Array
    marker_acceptance: Array
    instruments: tuple[Instrument, ...]
    gravity: Array
    payload: Payload
    load: Load | None
    effects: tuple[str, ...]
    knots: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, Array] = field(default_factory=dict)
    capsules: Mapping[str, tuple[Capsule, ...]] = field(default_factory=dict)
    unread: tuple[str, ...] = ()
    own_shapes: bool = False
    stands_at: float | None = None
    design: Planned = field(default_factory=Planned)
    repeatability: Repeatability | None = None
    excluded: tuple[str, ...] = ()
    gear_ratios: Mapping[str, float] = field(default_factory=dict)
    dh_convention: Convention | None = None
    known_distances: tuple[KnownDistance, ...] = ()
    bodies: Mapping[str, slice] = field(default_factory=dict)
    prior: Prior | None = None
    prior_file: Path | None = None
    size_prior: SizePrior = "estimated"
    acceptance: Acceptance | None = None
    about: Mapping[str, str] = field(default_factory=dict)

    @property
    def robot_source(self) -> str:
        """What holds the nominal model, in words."""
        return _SOURCES[self.robot_form]

    @property
    def named_files(self) -> tuple[Path, ...]:
        """What the cell names beside the robot: its targets, and what the robot's type knows."""
        targets = None if self.design.targets is None else self.design.targets.path
        return tuple(path for path in (targets, self.prior_file) if path is not None)

    @property
    def targets_in_words(self) -> str:
        """The targets: where they come from, or what stands for them."""
        return self.targets_source or "200 poses spread over the joint limits"

    @property
    def targets_source(self) -> str | None:
        """What holds the targets, in words; None where the cell has none of its own."""
        return None if self.design.targets is None else str(self.design.targets.path)

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
        return self.tracker.position

    @property
    def scatters(self) -> bool:
        """Whether the arm is known to come to a pose otherwise each time."""
        arm = self.repeatability
        return arm is not None and bool(arm.translation or arm.rotation)
