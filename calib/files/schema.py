"""The cell file as it is written: units in the names, checked before anything is computed."""

from __future__ import annotations

import math
from datetime import date, time
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias, Union

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Strict,
    Tag,
    model_validator,
)

from calib.arm.robot import FORMS, Form
from calib.files.looking import check_boards
from calib.files.values import (
    BoardTable,
    BodyTable,
    Count,
    Direction,
    Name,
    NotNegative,
    Number,
    Positive,
    Range,
    RidingTable,
    TomlTable,
    Vector,
    form_of,
    plain,
)
from calib.instruments import KINDS
from calib.instruments.camera_table import CameraTable
from calib.instruments.points import TrackerTable
from calib.instruments.protocol import TIP, WORLD, KeysTable

if TYPE_CHECKING:
    AnyInstrument: TypeAlias = KeysTable
else:
    _TABLES = tuple(own for _, own in KINDS.values())
    AnyInstrument = Annotated[Union[_TABLES], Field(discriminator="kind")]  # noqa: UP007


class CapsuleTable(TomlTable):
    start: Vector = Field(alias="from")
    end: Vector = Field(alias="to")
    radius: Positive


class AnchorTable(TomlTable):
    before: Vector
    after: Vector


class CouplingTable(TomlTable):
    of: Annotated[dict[str, Number], Field(min_length=1)]
    offset_deg: Number = 0.0
    offset_mm: Number = 0.0


class RobotTable(TomlTable):
    urdf: str | None = None
    mjcf: str | None = None
    dh: str | None = None
    dh_convention: Literal["classic", "modified"] | None = None
    base: str = ""
    tip: str = ""
    repeatability_mm: NotNegative | None = None
    repeatability_urad: NotNegative | None = None
    limits_deg: dict[str, Range] = {}
    limits_mm: dict[str, Range] = {}
    speed_deg_s: dict[str, Positive] = {}
    speed_mm_s: dict[str, Positive] = {}
    acceleration_deg_s2: dict[str, Positive] = {}
    acceleration_mm_s2: dict[str, Positive] = {}
    capsules_mm: dict[str, list[CapsuleTable]] = {}
    compensators_mm: dict[str, AnchorTable] = {}
    gear_ratio: dict[str, Positive] = {}
    coupled: dict[str, CouplingTable] = {}

    @model_validator(mode="after")
    def _one_file(self) -> Self:
        if len(self._files) != 1:
            raise ValueError(f"needs the robot's file, one of {', '.join(FORMS)}, and no second")
        if (self.dh is None) != (self.dh_convention is None):
            raise ValueError(
                "dh and dh_convention go together; write dh_convention = 'classic' or 'modified': the "
                "same numbers are another arm in the other"
            )
        for key in ("base", "tip"):
            if self.form in ("urdf", "mjcf") and not getattr(self, key):
                raise ValueError(
                    f"lacks {key}; name the {'first' if key == 'base' else 'last'} link or body"
                )
            if getattr(self, key):
                plain(getattr(self, key))
        return self

    @property
    def _files(self) -> dict[Form, str]:
        return {form: getattr(self, form) for form in FORMS if getattr(self, form) is not None}

    @property
    def form(self) -> Form:
        return next(iter(self._files))

    @property
    def file(self) -> str:
        return next(iter(self._files.values()))


_HEAVIEST = 2500.0  # kg: the largest arms on the market carry 2300
_PULLS_MOST = 30.0  # m/s^2
_STANDARD = 9.80665
_GRAVITIES = {"cm/s^2": 100.0, "mm/s^2": 1000.0, "ft/s^2": 3.28084, "in/s^2": 39.3701}


def _mass(kilograms: float) -> float:
    if kilograms > _HEAVIEST:
        grams = f"; if these are grams, write {kilograms / 1e3:g}"
        raise ValueError(f"no arm carries so many kilograms{grams}")
    return kilograms


def _gravity(m_s2: tuple[float, float, float]) -> tuple[float, float, float]:
    pull = math.hypot(*m_s2)
    if pull > _PULLS_MOST:
        unit = min(_GRAVITIES, key=lambda u: abs(math.log(pull / _GRAVITIES[u] / _STANDARD)))
        raise ValueError(
            f"is no gravity in m/s^2; if it is in {unit}, divide by {_GRAVITIES[unit]:g}"
        )
    return m_s2


Mass = Annotated[NotNegative, AfterValidator(_mass)]


class GravityTable(TomlTable):
    m_s2: Annotated[Vector, AfterValidator(_gravity)] = (0.0, 0.0, -9.80665)


class PayloadTable(RidingTable):
    mass_kg: Mass = 0.0
    com_mm: Vector = (0.0, 0.0, 0.0)


class LoadTable(RidingTable):
    mass_kg: Mass
    com_mm: Vector
    max_tilt_deg: Annotated[Number, Field(ge=0, le=90)] = 90.0


class MarkerTable(TomlTable):
    position: Vector
    on: Name | None = None
    normal: Direction | None = None
    acceptance_deg: Annotated[Number, Field(gt=0, le=180)] | None = None


Marker = Annotated[
    Annotated[Vector, Tag("plain")] | Annotated[MarkerTable, Tag("table")], Discriminator(form_of)
]


class KnownDistanceTable(TomlTable):
    between: tuple[Name, Name]
    mm: Positive
    sigma_mm: Positive


class LevelsTable(TomlTable):
    poses_per_level: Count
    count: Count | None = None
    min_separation_deg: NotNegative = 0.0
    values_deg: list[Number] | None = None


class BoxTable(TomlTable):
    type: Literal["box"]
    center_mm: Vector
    size_mm: tuple[Positive, Positive, Positive]
    rpy_deg: Vector = (0.0, 0.0, 0.0)


class BallTable(TomlTable):
    type: Literal["sphere"]
    center_mm: Vector
    radius_mm: Positive


class HalfSpaceTable(TomlTable):
    type: Literal["halfspace"]
    point_mm: Vector
    normal: Direction


def _no_switch(value: object) -> object:
    """Refuse the value that said that there is no floor: none is assumed."""
    if value is False:
        raise ValueError("takes a height; leave it out where there is no floor")
    return value


FloorHeight = Annotated[Number, BeforeValidator(_no_switch)]


class DesignTable(TomlTable):
    poses: Count | None = None
    levels: dict[str, LevelsTable] = {}
    targets: str | None = None
    targets_after_h: NotNegative | None = None
    repeats: Annotated[bool, Strict()] = False
    reapproaches: Count | None = None
    floor_mm: FloorHeight | None = None
    margin_mm: NotNegative = 0.0
    obstacle: list[
        Annotated[BoxTable | BallTable | HalfSpaceTable, Field(discriminator="type")]
    ] = []


class TimingTable(TomlTable):
    speed_percent: Annotated[Positive, Field(le=100)] = 10.0
    settle_s: NotNegative = 2.0
    read_s: NotNegative = 10.0
    load_change_min: NotNegative = 2.0


class DiagnosisTable(TomlTable):
    exclude: list[str] = []


class AcceptanceTable(TomlTable):
    tolerance_mm: Positive


def _widths(value: object) -> object:
    """What stands for widths, or the one line that says what would."""
    numbers = value.values() if isinstance(value, dict) else ()
    right = all(type(n) in (int, float) and 0.0 < n < math.inf for n in numbers)
    if value in ("estimated", "off") or (isinstance(value, dict) and numbers and right):
        return value
    raise ValueError(
        'must be "estimated", "off", or widths above zero, as { geometry_mrad = 10, geometry_mm = 3 }'
    )


class ModelTable(TomlTable):
    effects: Annotated[list[str], Field(min_length=1)]
    knots_deg: dict[str, list[Number]] = {}
    size_prior: Annotated[
        Literal["estimated", "off"] | dict[str, Positive], BeforeValidator(_widths)
    ] = "estimated"


_LONGEST_TEXT = 300


def _told(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, str | int | float | date | time):
        raise ValueError("is no text, number or date")
    if len(str(value)) > _LONGEST_TEXT or not str(value).isprintable():
        raise ValueError(f"is no line of text, of {_LONGEST_TEXT} characters at most")
    return value


Told = Annotated[Any, AfterValidator(_told)]
"""What a reader is told as it stands."""


class CellFile(TomlTable):
    """The whole file."""

    format: Literal[1] = Field(alias="schema")
    name: Name | None = None
    robot: RobotTable
    markers_mm: dict[Name, Marker] = {}
    bodies: dict[Name, BodyTable] = {}
    boards: dict[Name, BoardTable] = {}
    instrument: TrackerTable | None = None
    instruments: dict[Name, AnyInstrument] = {}
    known_distances: list[KnownDistanceTable] = []
    gravity: GravityTable = GravityTable()
    payload: PayloadTable = PayloadTable()
    load: LoadTable | None = None
    design: DesignTable = DesignTable()
    timing: TimingTable = TimingTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
    acceptance: AcceptanceTable | None = None
    report: dict[Name, Told] = {}
    model: ModelTable

    def on_of(self, marker: str) -> str:
        """Where a marker rides: a link, or the tip."""
        own = self.markers_mm[marker]
        return (own.on if isinstance(own, MarkerTable) else None) or TIP

    def link(self, on: str) -> str:
        """The link that is named so."""
        return self.robot.tip if on == TIP else on

    def link_of(self, marker: str) -> str:
        """The link on which a marker rides."""
        return self.link(self.on_of(marker))

    @property
    def cameras(self) -> dict[str, CameraTable]:
        """Those of the instruments, by their names."""
        found = self.instruments.items()
        return {name: own for name, own in found if isinstance(own, CameraTable)}

    @property
    def carried(self) -> dict[str, CameraTable]:
        """Cameras on links before boards in the world: what is found of them is where they ride."""
        return {n: own for n, own in self.cameras.items() if own.rides_before(self.boards)}

    @property
    def _reading_markers(self) -> list[str]:
        """Cameras that read markers: all but those that ride before the world, or with all markers."""
        links = set(map(self.on_of, self.markers_mm))
        return [n for n, own in self.cameras.items() if links - {own.on} and n not in self.carried]

    @property
    def _riding(self) -> list[RidingTable]:
        """All but markers that may ride on a link."""
        found: list[RidingTable] = [*self.bodies.values(), *self.boards.values(), self.payload]
        found += self.instruments.values()
        return found if self.load is None else [*found, self.load]

    @property
    def links(self) -> tuple[str, ...]:
        """Links beside the tip on which anything rides."""
        every = [*map(self.on_of, self.markers_mm), *(own.on for own in self._riding)]
        return tuple(link for link in dict.fromkeys(every) if link not in (TIP, WORLD))

    @model_validator(mode="after")
    def _tip_by_one_name(self) -> Self:
        markers = [own for own in self.markers_mm.values() if isinstance(own, MarkerTable)]
        every: list[MarkerTable | RidingTable] = [*markers, *self._riding]
        for own in every:
            if own.on == self.robot.tip:
                own.on = TIP
        return self

    @model_validator(mode="after")
    def _load_once(self) -> Self:
        own, load = self.payload, self.load
        apart = load is None or (own.com_mm, own.on) != (load.com_mm, load.on)
        if load is None or apart or not own.mass_kg:
            return self
        if math.isclose(own.mass_kg, load.mass_kg, rel_tol=0.01):
            raise ValueError(
                "[payload] and [load] are the same mass at the same place; it counts once: keep "
                "[payload] if it is carried at every pose, [load] if it is hung on for a second reading"
            )
        return self

    @model_validator(mode="after")
    def _something_read(self) -> Self:
        if self.instrument is None and not self.instruments:
            raise ValueError(
                "has no [instrument]; add it, as in the cell that `posecal demo` writes"
            )
        if self.instrument is not None and self.instruments:
            raise ValueError(
                "has [instrument] and [instruments]; make [instrument] one of these, too"
            )
        read = {entry.kind: entry.reads for entry in self.instruments.values()}
        read = read or {"points": "markers"}
        touching = [kind for kind, what in read.items() if what == "markers"]
        if touching and not self.markers_mm:
            raise ValueError(f"reads {min(touching)} and has no [markers_mm]; add what is read")
        facing = [kind for kind, what in read.items() if what == "bodies"]
        if facing and not self.bodies:
            raise ValueError(f"reads {min(facing)} and has no [bodies]; add what is read")
        if self.bodies and not facing:
            raise ValueError("has [bodies] and no instrument of kind pose that reads them")
        reading = self._reading_markers
        if not touching and self.markers_mm and not reading:
            raise ValueError("has [markers_mm] and no instrument that reads them")
        check_boards(self.cameras, self.boards, reading)
        named = [*self.markers_mm, *self.bodies, *self.boards, *self.carried]
        if len(named) > len(set(named)):
            twice = next(name for name in named if named.count(name) > 1)
            raise ValueError(f"{twice!r} names two things; rename one")
        return self
