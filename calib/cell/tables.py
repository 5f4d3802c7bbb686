"""The cell file: its keys with their units, checked, and what they become in SI."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import date, time
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias, Union

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from calib.arm.robot import FORMS, Capsule, Form, Shapes
from calib.arm.statics import STANDARD_GRAVITY
from calib.arrays import Array
from calib.cell.planned import Load, Pace, Planned, Repeatability
from calib.instruments import KINDS, KnownDistance
from calib.instruments.board import BoardTable
from calib.instruments.camera import CameraTable
from calib.instruments.keys_table import BodyTable, KeysTable, RidingTable
from calib.instruments.protocol import TIP, WORLD
from calib.instruments.tracker import TrackerTable
from calib.keys import (
    DEG,
    MM,
    URAD,
    Direction,
    Mass,
    Name,
    NotNegative,
    NotNegativeMetres,
    Number,
    Place,
    Point,
    Positive,
    PositiveMetres,
    Range,
    TomlTable,
    Vector,
    Written,
    form_of,
    key,
    plain,
    times,
)
from calib.motion.filtering import CUTOFF

if TYPE_CHECKING:
    AnyInstrument: TypeAlias = KeysTable
else:
    _TABLES = tuple(own for _, own in KINDS.values())
    AnyInstrument = Annotated[Union[_TABLES], Field(discriminator="kind")]  # noqa: UP007


class CapsuleTable(TomlTable):
    """A capsule; a field cannot be called as its key is."""

    start: Annotated[Place, key("from")]
    """one end of the axis, in the frame that turns with the joint; for base in the base's frame, for
    tool in the tip's"""
    end: Annotated[Place, key("to")]
    """the other end"""
    radius: PositiveMetres
    """radius of the capsule"""


class AnchorTable(TomlTable):
    """Where the spring of a gravity compensator hangs; m."""

    before: Point
    """anchor on the link before the joint, measured from the joint's origin"""
    after: Point
    """anchor on the link after the joint"""


class CouplingTable(TomlTable):
    """What moves a joint that has no drive."""

    of: Annotated[dict[str, Number], Field(min_length=1)]
    """joints that move it, each with its factor (rad or m by rad or m)"""
    offset_deg: Number = 0.0
    """where it stands when those are at zero"""
    offset_mm: Number = 0.0
    """the same of a joint that slides"""


_OneCapsule = Annotated[Capsule, Written(CapsuleTable, lambda own: Capsule(**dict(own)))]
_Capsules = Annotated[tuple[Capsule, ...], Written(list[_OneCapsule], tuple)]
_Anchors = Annotated[Array, Written(AnchorTable, lambda own: np.array([own.before, own.after]))]


class RobotTable(TomlTable):
    """The robot's file, and what it does not say."""

    urdf: str | None = None
    """the robot's file, relative to the cell; write one of urdf, mjcf, dh"""
    mjcf: str | None = None
    """a MuJoCo model (posecal explain robots)"""
    dh: str | None = None
    """a Denavit-Hartenberg table (posecal explain robots)"""
    dh_convention: Literal["classic", "modified"] | None = None
    """convention of the DH table"""
    base: str = ""
    """first link; its frame is that of gravity, obstacles and the instrument's position"""
    tip: str = ""
    """last link; its frame is that of markers, payload and load"""
    repeatability_mm: NotNegativeMetres | None = None
    """repeatability of the arm, from visit to visit: one standard deviation of one coordinate of the
    tip"""
    repeatability_urad: Annotated[NotNegative, times(URAD)] | None = None
    """the same for one component of the tip's rotation"""
    limits_deg: dict[str, Range] = {}
    """narrower limits of joints that turn"""
    limits_mm: dict[str, Range] = {}
    """narrower limits of joints that slide"""
    speed_deg_s: dict[str, Positive] = {}
    """largest speed of joints that turn, instead of the robot file's, for the duration of a plan"""
    speed_mm_s: dict[str, Positive] = {}
    """largest speed of joints that slide"""
    acceleration_deg_s2: dict[str, Positive] = {}
    """largest acceleration of joints that turn; without it the full speed is reached in half a
    second"""
    acceleration_mm_s2: dict[str, Positive] = {}
    """largest acceleration of joints that slide"""
    capsules: Annotated[dict[str, _Capsules] | None, key("capsules_mm")] = None
    """shapes of joints, base and tool, instead of those in the robot's file; an empty table means none
    (posecal explain constraints)"""
    anchors: Annotated[dict[str, _Anchors], key("compensators_mm")] = {}
    """springs of gravity_compensator, by joint"""
    gear_ratios: Annotated[dict[str, Positive], key("gear_ratio")] = {}
    """turns of the motor (or wave generator) for one turn of the joint; gear_ripple is tried at this
    ratio only"""
    torque_constants: Annotated[dict[str, Positive], key("torque_constant_Nm_A")] = {}
    """torque at the joint for one ampere of its motor; without it the constants are estimated from
    motions"""
    coupled: dict[str, CouplingTable] = {}
    """joints without a drive that others move together, as a rod keeps a link level"""

    @model_validator(mode="after")
    def _one_file(self) -> Self:
        if len(self._files) != 1:
            raise ValueError(f"needs the robot's file, one of {', '.join(FORMS)}, and no second")
        if (self.dh is None) != (self.dh_convention is None):
            raise ValueError(
                "dh and dh_convention go together; write dh_convention = 'classic' or 'modified': the "
                "same numbers are another arm in the other"
            )
        for end, which in (("base", "first"), ("tip", "last")):
            if not getattr(self, end) and self.form != "dh":
                raise ValueError(f"lacks {end}; name the {which} link or body")
            if getattr(self, end):
                plain(getattr(self, end))
        return self

    @property
    def _files(self) -> dict[Form, str]:
        return {form: getattr(self, form) for form in FORMS if getattr(self, form) is not None}

    @property
    def form(self) -> Form:
        """In which the robot's file is."""
        return next(iter(self._files))

    @property
    def file(self) -> str:
        """The robot's file."""
        return self._files[self.form]

    @property
    def shapes(self) -> Shapes | None:
        """Those that stand in place of the file's, which may be none; None where it says nothing."""
        return None if self.capsules is None else Shapes(self.capsules)

    @property
    def repeatability(self) -> Repeatability | None:
        """As stated; what is not stated beside the other is none."""
        stated = self.repeatability_mm, self.repeatability_urad
        return None if stated == (None, None) else Repeatability(*(own or 0.0 for own in stated))

    def of_joints(self) -> Iterator[tuple[bool, str, float, Mapping[str, Any]]]:
        """Whether joints slide, a key of such joints, its unit in SI, and its values by joint."""
        for name in ("limits_{}", "speed_{}_s", "acceleration_{}_s2"):
            for slides, unit, scale in ((False, "deg", DEG), (True, "mm", MM)):
                own = name.format(unit)
                yield slides, own, scale, getattr(self, own)


_PULLS_MOST = 30.0  # m/s^2
_GRAVITIES = {"cm/s^2": 100.0, "mm/s^2": 1000.0, "ft/s^2": 3.28084, "in/s^2": 39.3701}


def _gravity(m_s2: tuple[float, float, float]) -> tuple[float, float, float]:
    pull = math.hypot(*m_s2)
    if pull > _PULLS_MOST:
        standard = -STANDARD_GRAVITY[2]
        unit = min(_GRAVITIES, key=lambda u: abs(math.log(pull / _GRAVITIES[u] / standard)))
        raise ValueError(
            f"is no gravity in m/s^2; if it is in {unit}, divide by {_GRAVITIES[unit]:g}"
        )
    return m_s2


class GravityTable(TomlTable):
    """Which way the base stands."""

    m_s2: Annotated[Vector, AfterValidator(_gravity)] = STANDARD_GRAVITY
    """gravity in the base's frame"""


class PayloadTable(RidingTable):
    """A body that is always carried."""

    on: Name = TIP
    """link that carries it, where that is not the tip"""
    mass: Annotated[Mass, key("mass_kg")] = 0.0
    """mass that the arm carries at every pose"""
    com: Annotated[Place, key("com_mm")] = (0.0, 0.0, 0.0)
    """its centre of mass, in the frame of its link"""


class MarkerTable(TomlTable):
    """A marker of which more is said than its position."""

    position: Point
    """position of the marker"""
    on: Name = TIP
    """link on which it rides, where that is not the tip"""
    normal: Direction | None = None
    """direction in which the marker looks, for line of sight"""
    acceptance: Annotated[
        Annotated[Number, Field(gt=0, le=180), times(DEG)] | None, key("acceptance_deg")
    ] = None
    """largest angle between this direction and the line of sight"""


Marker = Annotated[
    Annotated[MarkerTable, Written(Vector, lambda point: MarkerTable(position=point)), Tag("plain")]
    | Annotated[MarkerTable, Tag("table")],
    Discriminator(form_of),
]


class DiagnosisTable(TomlTable):
    """What a diagnosis need not ask."""

    exclude: list[str] = []
    """causes that this robot cannot have: name or name:where"""


class MotionTable(TomlTable):
    """How motions are read."""

    cutoff: Annotated[Positive, key("cutoff_hz")] = CUTOFF
    """cutoff of the filter that all channels go through"""


class AcceptanceTable(TomlTable):
    """What passes."""

    tolerance: Annotated[PositiveMetres, key("tolerance_mm")]
    """largest distance allowed between a held-out point and its prediction: pass or fail"""


def _widths(value: object) -> object:
    """What stands for widths, or the one line that says what would."""
    numbers = value.values() if isinstance(value, dict) else ()
    right = all(type(n) in (int, float) and 0.0 < n < math.inf for n in numbers)
    if value in ("estimated", "off") or (isinstance(value, dict) and numbers and right):
        return value
    raise ValueError(
        'must be "estimated", "off", or widths above zero, as { geometry_mrad = 10, geometry_mm = 3 }'
    )


def _knots(angles: list[float]) -> Array:
    if not angles or len(set(angles)) < len(angles):
        raise ValueError("needs angles, each one once")
    return np.sort(np.radians(angles))


class ModelTable(TomlTable):
    """What is identified."""

    effects: list[str] = []
    """what is identified (posecal explain effects)"""
    knots: Annotated[
        dict[str, Annotated[Array, Written(list[Number], _knots)]], key("knots_deg")
    ] = {}
    """angles, by joint, at which stiffness_vs_angle has a coefficient; without it the plan's levels, or
    angles of the data"""
    size_prior: Annotated[
        Literal["estimated", "off"] | dict[str, Positive], BeforeValidator(_widths)
    ] = "estimated"
    """prior for the size of errors. It decides what few poses leave open. It is found from the data,
    switched off, or stated as { geometry_mrad = 10, geometry_mm = 3 } (posecal explain uncertainty)"""


_LONGEST_TEXT = 300


def _line(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float | date | time):
        raise ValueError("is no text, number or date")
    if len(str(value)) > _LONGEST_TEXT or not str(value).isprintable():
        raise ValueError(f"is no line of text, of {_LONGEST_TEXT} characters at most")
    return str(value)


class CellFile(TomlTable):
    """The whole file."""

    format: Annotated[Literal[1], key("schema")]
    """version of this format"""
    name: Name | None = None
    """name of the cell; it stands before every result"""
    robot: RobotTable
    markers_mm: dict[Name, Marker] = {}
    """rough positions of the markers in the tip frame: a position, or a table"""
    bodies: dict[Name, BodyTable] = {}
    """frames on links that an instrument of kind pose reads"""
    boards: dict[Name, BoardTable] = {}
    """boards of known shape that cameras see"""
    instrument: TrackerTable | None = None
    instruments: dict[Name, AnyInstrument] = {}
    """several instruments, or other kinds; rows of the table name theirs"""
    known_distances: list[KnownDistance] = []
    """known distances between two sockets or two markers"""
    gravity: GravityTable = GravityTable()
    payload: PayloadTable = PayloadTable()
    load: Load | None = None
    design: Planned = Planned()
    timing: Pace = Pace()
    motion: MotionTable = MotionTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
    acceptance: AcceptanceTable | None = None
    report: dict[Name, Annotated[str, Written(Any, _line)]] = {}
    model: ModelTable = ModelTable()

    @model_validator(mode="before")
    @classmethod
    def _tip_by_one_name(cls, raw: dict[str, Any]) -> dict[str, Any]:
        """Of what rides on the tip by the name of its link: ``on = "tip"``."""
        robot = raw.get("robot")
        tip = robot.get("tip") if isinstance(robot, dict) else None
        for table in ("markers_mm", "bodies", "boards", "instruments", "payload", "load"):
            own = raw.get(table)
            for entry in [own, *own.values()] if isinstance(own, dict) else ():
                if isinstance(entry, dict) and tip is not None and entry.get("on") == tip:
                    entry["on"] = TIP
        return raw

    def link(self, on: str) -> str:
        """The link that is named so."""
        return self.robot.tip if on == TIP else on

    @property
    def cameras(self) -> dict[str, CameraTable]:
        """Those of the instruments, by their names."""
        every = self.instruments.items()
        return {name: own for name, own in every if isinstance(own, CameraTable)}

    @property
    def carried(self) -> dict[str, CameraTable]:
        """Cameras on links before boards in the world: what is found of them is where they ride."""
        return {n: own for n, own in self.cameras.items() if own.rides_before(self.boards)}

    @property
    def seated(self) -> dict[str, KeysTable]:
        """All other instruments that ride on links."""
        every, carried = self.instruments.items(), self.carried
        return {name: own for name, own in every if own.on != WORLD and name not in carried}

    @property
    def links(self) -> tuple[str, ...]:
        """Links beside the tip on which anything rides."""
        several = (self.markers_mm, self.bodies, self.boards, {"": self.payload}, self.instruments)
        ridden = [own.on for table in several for own in table.values()]
        ridden += [] if self.load is None else [self.load.on]
        return tuple(link for link in dict.fromkeys(ridden) if link not in (TIP, WORLD))

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        faults = (
            self._load_twice(),
            *self._unread(),
            *(fault for name, own in self.cameras.items() for fault in self._unseeing(name, own)),
            *self._idle(),
            *self._names_twice(),
            *self._distances(),
        )
        if fault := next(filter(None, faults), None):
            raise ValueError(fault)
        return self

    def _load_twice(self) -> str:
        own, load = self.payload, self.load
        if load is None or not own.mass or own.on != load.on or own.com != load.com:
            return ""
        if not math.isclose(own.mass, load.mass, rel_tol=0.01):
            return ""
        return (
            "[payload] and [load] are the same mass at the same place; it counts once: keep "
            "[payload] if it is carried at every pose, [load] if it is hung on for a second reading"
        )

    def _unread(self) -> Iterator[str]:
        """What is there to be read and is not, or should be there."""
        ridden = self.markers_mm or self.bodies or self.boards
        if ridden and self.instrument is None and not self.instruments:
            yield "has no [instrument]; add it, as in the cell that `posecal demo` writes"
        if self.instrument is not None and self.instruments:
            yield "has [instrument] and [instruments]; make [instrument] one of these, too"
        read = {entry.kind: entry.reads for entry in self.instruments.values()}
        if self.instrument is not None:
            read = {"points": "markers"}
        for what, table in (("markers", "markers_mm"), ("bodies", "bodies")):
            if (kinds := [k for k, own in read.items() if own == what]) and not getattr(
                self, table
            ):
                yield f"reads {min(kinds)} and has no [{table}]; add what is read"

    def _idle(self) -> Iterator[str]:
        """What no instrument reads."""
        read = [entry.reads for entry in self.instruments.values()]
        seen = {board for camera in self.cameras.values() for board in camera.seen(self.boards)}
        idle = [
            f"board {name} on {self.boards[name].on}" for name in self.boards if name not in seen
        ]
        if "bodies" not in read:
            idle += self.bodies
        if self.instrument is None and "markers" not in read and not self._reading_markers:
            idle += self.markers_mm
        yield from (f"has {own} and no instrument elsewhere that reads it" for own in idle)

    def _names_twice(self) -> Iterator[str]:
        named = Counter([*self.markers_mm, *self.bodies, *self.boards, *self.carried])
        yield from (f"{n!r} names two things; rename one" for n, k in named.items() if k > 1)

    @property
    def _reading_markers(self) -> set[str]:
        """Cameras that read markers: but those that ride before the world, or with all markers."""
        links = {own.on for own in self.markers_mm.values()}
        return {n for n, own in self.cameras.items() if links - {own.on}} - self.carried.keys()

    def _unseeing(self, name: str, camera: CameraTable) -> Iterator[str]:
        """Why a camera sees nothing, or not what it should."""
        for one in camera.boards or ():
            if one not in self.boards or self.boards[one].on == camera.on:
                fault = "rides with it" if one in self.boards else "is none of [boards]"
                yield f"has camera {name}, whose board {one} {fault}; take it out"
        own = camera.seen(self.boards)
        if not own and name not in self._reading_markers:
            where = "'tip'" if camera.on == WORLD else "'world', or on another link"
            yield f"has camera {name} and nothing that it sees; add [boards.NAME] with on = {where}"
        if camera.rides_before(self.boards) and any(b.on != WORLD for b in own.values()):
            yield (
                f"has camera {name}, that sees boards in the world and on other links; name some of "
                "one kind, boards = ['NAME', ..], or let those in the world ride on [robot] base"
            )

    def _distances(self) -> Iterator[str]:
        """Known distances that are not between two sockets or two markers of one link."""
        sockets = [name for name, own in self.instruments.items() if own.kind == "socket"]
        on = {name: self.link(own.on) for name, own in self.markers_mm.items()}
        for number, own in enumerate(self.known_distances):
            (a, b), where = own.between, f"known_distances.{number}.between"
            if a in on and b in on and on[a] != on[b]:
                ride = f"ride on {on[a]} and {on[b]}, and are no known length apart; take it out"
                yield f"{where}: {a!r} and {b!r} {ride}"
            if a == b or not any(a in names and b in names for names in (sockets, on)):
                known = f"those are {', '.join([*sorted(sockets), *on][:12])}"
                what = f"{a!r} and {b!r} are not two sockets or two markers of the cell"
                yield f"{where}: {what}; {known}"
