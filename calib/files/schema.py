"""The cell file as it is written: units in the names, checked before anything is computed."""

from __future__ import annotations

import math
from datetime import date, time
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    Tag,
    model_validator,
)

from calib.cell import FORMS, Form
from calib.files.read import fault_of_name

_LARGEST = 1e9  # in any unit
_SMALLEST = 1e-9
_HEAVIEST = 2500.0  # kg: the largest arms on the market carry 2300
_PULLS_MOST = 30.0  # m/s^2
_STANDARD = 9.80665
_GRAVITIES = {"cm/s^2": 100.0, "mm/s^2": 1000.0, "ft/s^2": 3.28084, "in/s^2": 39.3701}
_LONGEST_TEXT = 300
_SYMMETRIC = 1e-6  # of the deviations


def _plausible(value: float) -> float:
    if abs(value) > _LARGEST:
        raise ValueError("is of no plausible size")
    return value


def _not_vanishing(value: float) -> float:
    if value < _SMALLEST:
        raise ValueError("is too small to mean anything")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False), AfterValidator(_plausible)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_vanishing)]
NotNegative = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]
Vector = tuple[Number, Number, Number]
Row = tuple[Number, Number, Number, Number, Number, Number]


def _plain(name: str) -> str:
    if fault := fault_of_name(name):
        raise ValueError(f"the name {fault}")
    return name


Name = Annotated[str, AfterValidator(_plain)]


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"lower limit {limits[0]:g} is above upper limit {limits[1]:g}")
    return limits


def _direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(map(abs, vector)) < _SMALLEST:
        raise ValueError("a direction must not be zero")
    return vector


Range = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
Direction = Annotated[Vector, AfterValidator(_direction)]


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


class Table(BaseModel):
    """A TOML table without unknown keys."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)


class CapsuleTable(Table):
    start: Vector = Field(alias="from")
    end: Vector = Field(alias="to")
    radius: Positive


class AnchorTable(Table):
    before: Vector
    after: Vector


class RobotTable(Table):
    urdf: str | None = None
    mjcf: str | None = None
    dh: str | None = None
    dh_convention: Literal["classic", "modified"] | None = None
    kinematics: str | None = None
    base: str = ""
    tip: str = ""
    repeatability_mm: NotNegative | None = None
    repeatability_urad: NotNegative | None = None
    limits_deg: dict[str, Range] = {}
    limits_mm: dict[str, Range] = {}
    capsules_mm: dict[str, list[CapsuleTable]] = {}
    compensators_mm: dict[str, AnchorTable] = {}
    gear_ratio: dict[str, Positive] = {}

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
                _plain(getattr(self, key))
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


class MarkerTable(Table):
    position: Vector
    normal: Direction | None = None
    acceptance_deg: Annotated[Number, Field(gt=0, le=180)] | None = None


class PolarSigma(Table):
    range_mm: Positive
    transverse_mm: Positive
    range_mm_per_m: NotNegative = 0.0
    transverse_mm_per_m: NotNegative = 0.0


class MpeSigma(Table):
    mpe_mm: Positive
    mpe_mm_per_m: NotNegative = 0.0
    divisor: Positive


def _kind_of_sigma(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "mpe"
            if any(str(key).startswith("mpe") or key == "divisor" for key in value)
            else "polar"
        )
    return "number"


Sigma = Annotated[
    Annotated[Positive, Tag("number")]
    | Annotated[PolarSigma, Tag("polar")]
    | Annotated[MpeSigma, Tag("mpe")],
    Discriminator(_kind_of_sigma),
]


def _kind_of_marker(value: Any) -> str:
    return "table" if isinstance(value, dict) else "position"


Marker = Annotated[
    Annotated[Vector, Tag("position")] | Annotated[MarkerTable, Tag("table")],
    Discriminator(_kind_of_marker),
]


DIVISORS = {"normal": 2.0, "rectangular": 3.0**0.5, "triangular": 6.0**0.5, "arcsine": 2.0**0.5}
"""By which a limit becomes one standard uncertainty (JCGM 100, 4.3); a normal one may have its own."""


class LimitTable(Table):
    limit: Positive
    distribution: Literal["normal", "rectangular", "triangular", "arcsine"] = "rectangular"
    divisor: Positive | None = None
    degrees_of_freedom: Annotated[Number, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _own_divisor(self) -> Self:
        if self.divisor is not None and self.distribution != "normal":
            raise ValueError(
                f"divisor of a {self.distribution} distribution is {DIVISORS[self.distribution]:.4g}; "
                "take it out, or write distribution = 'normal'"
            )
        return self


def _kind_of_common(value: Any) -> str:
    return "table" if isinstance(value, dict) else "number"


Uncertainty = Annotated[
    Annotated[NotNegative, Tag("number")] | Annotated[LimitTable, Tag("table")],
    Discriminator(_kind_of_common),
]
"""One standard uncertainty, or a limit with its distribution."""


class CommonTable(Table):
    scale_um_m: Uncertainty | None = None
    r0_um: Uncertainty | None = None
    transverse_um: Uncertainty | None = None
    transverse_um_m: Uncertainty | None = None
    eccentricity_urad: Uncertainty | None = None
    temperature_degC: Uncertainty | None = None  # noqa: N815
    pressure_hPa: Uncertainty | None = None  # noqa: N815
    level_urad: Uncertainty | None = None


class InstrumentTable(Table):
    sigma_mm: Sigma
    position_mm: Vector | None = None
    common: CommonTable = CommonTable()


class DistanceTable(Table):
    kind: Literal["distance"]
    sigma_mm: Positive
    anchor_mm: Vector | None = None
    offset: Annotated[bool, Strict()] = False
    reach_mm: Annotated[tuple[NotNegative, NotNegative], AfterValidator(_ordered)] | None = None

    @model_validator(mode="after")
    def _reach_from_somewhere(self) -> Self:
        if self.reach_mm is not None and self.anchor_mm is None:
            raise ValueError("has reach_mm, which counts from anchor_mm; add that")
        return self


class PlaneTable(Table):
    kind: Literal["plane"]
    sigma_mm: Positive
    position_mm: Vector | None = None
    normal: Direction | None = None

    @model_validator(mode="after")
    def _whole_plane(self) -> Self:
        if (self.position_mm is None) != (self.normal is None):
            raise ValueError("position_mm, a point of it, and normal go together")
        return self


class SphereTable(Table):
    kind: Literal["sphere"]
    sigma_mm: Positive
    radius_mm: Positive | None = None
    about_radius_mm: Positive | None = None
    position_mm: Vector | None = None


class SocketTable(Table):
    kind: Literal["socket"]
    sigma_mm: Positive
    position_mm: Vector | None = None


class PointsTable(InstrumentTable):
    kind: Literal["points"]


class PoseTable(Table):
    kind: Literal["pose"]
    sigma_mm: Positive | None = None
    sigma_urad: Positive | None = None
    covariance: tuple[Row, Row, Row, Row, Row, Row] | None = None  # mm and urad, body axes

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        stated = (self.sigma_mm is not None, self.sigma_urad is not None)
        if self.covariance is None and not all(stated):
            raise ValueError("needs its noise, sigma_mm and sigma_urad, or covariance")
        if self.covariance is not None:
            if any(stated):
                raise ValueError("has both sigma and covariance; keep one of them")
            _refuse_no_covariance(np.array(self.covariance))
        return self


def _refuse_no_covariance(C: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> None:
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    if not (size > 0.0).all():
        raise ValueError("covariance needs variances above zero on its diagonal")
    scaled = C / np.outer(size, size)
    if np.abs(scaled - scaled.T).max() > _SYMMETRIC:
        raise ValueError("covariance is not symmetric")
    if np.linalg.eigvalsh(scaled)[0] < _SMALLEST:
        raise ValueError("covariance is not positive definite")


class BodyTable(Table):
    position_mm: Vector = (0.0, 0.0, 0.0)
    rpy_deg: Vector = (0.0, 0.0, 0.0)


Anywhere = Annotated[float, Strict(), Field(allow_inf_nan=False)]
"""A coordinate that need not be plausible as long as nobody measures the point."""


class BoardTable(BodyTable):
    on: Literal["tip", "world"]
    points_mm: dict[Name, tuple[Anywhere, Anywhere, Anywhere]] = {}
    squares: tuple[Count, Count] | None = None
    pitch_mm: Positive | None = None
    marker_mm: Positive | None = None  # of the markers in its white squares
    tags: tuple[Count, Count] | None = None
    tag_mm: Positive | None = None
    gap_mm: Positive | None = None
    first_tag: Annotated[int, Strict(), Field(ge=0, le=1_000_000)] = 0
    dictionary: str | None = None  # of markers or tags, as OpenCV calls it

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        shapes = [bool(self.points_mm), self.squares is not None, self.tags is not None]
        if sum(shapes) != 1:
            raise ValueError(
                "needs its shape: either points_mm, or squares and pitch_mm, or tags, tag_mm and gap_mm"
            )
        if (self.squares is None) != (self.pitch_mm is None):
            raise ValueError("squares and pitch_mm go together")
        if not (self.tags is None) == (self.tag_mm is None) == (self.gap_mm is None):
            raise ValueError("tags, tag_mm and gap_mm go together")
        if (self.marker_mm is None) != (self.dictionary is None) and self.tags is None:
            raise ValueError(
                "marker_mm and dictionary go together: they make squares a ChArUco board"
            )
        if self.marker_mm is not None and self.marker_mm >= (self.pitch_mm or 0.0):
            raise ValueError("marker_mm belongs to squares, and is smaller than pitch_mm")
        if self.tags is not None and math.prod(self.tags) > 2500:
            raise ValueError("tags are as many as the board has, [across, down], at most 2500")
        if self.squares is not None and not 4 <= math.prod(n - 1 for n in self.squares) <= 10_000:
            raise ValueError(
                "squares are as many as the board has, [across, down], with four corners"
            )
        return self


Pixels = tuple[Positive, Positive]
Coefficients = tuple[Number, Number, Number, Number] | tuple[Number, Number, Number, Number, Number]


class IntrinsicsStd(Table):
    focal_px: Positive | None = None
    center_px: Positive | None = None
    distortion: Positive | Annotated[list[Positive], Field(min_length=4, max_length=5)] | None = (
        None
    )


class CameraTable(BodyTable):
    kind: Literal["camera"]
    on: Literal["world", "tip"] = "world"
    calibration: str | None = None  # a file in place of the next three
    focal_px: Positive | Pixels = 1.0
    center_px: tuple[Number, Number] = (0.0, 0.0)
    distortion: Coefficients = (0.0, 0.0, 0.0, 0.0, 0.0)
    image_px: Pixels | None = None
    sigma_px: Positive
    free: list[Literal["focal", "center", "distortion"]] = []
    intrinsics_std: (
        IntrinsicsStd | Annotated[list[Positive], Field(min_length=1, max_length=9)] | None
    ) = None  # in a list: fx, fy, cx, cy, k1, k2, p1, p2, k3

    @model_validator(mode="after")
    def _one_lens(self) -> Self:
        own = [k for k in ("focal_px", "center_px", "distortion") if k in self.model_fields_set]
        if self.calibration is not None and own:
            raise ValueError(f"has calibration and {own[0]}; keep one of them")
        for key in ("focal_px", "center_px"):
            if self.calibration is None and key not in own:
                raise ValueError(f"lacks {key}; add it, or calibration = a YAML of OpenCV or ROS")
        return self


class AngleTable(Table):
    kind: Literal["angle"]
    sigma_urad: Positive


AnyInstrument = Annotated[
    PointsTable
    | PoseTable
    | CameraTable
    | AngleTable
    | DistanceTable
    | PlaneTable
    | SphereTable
    | SocketTable,
    Field(discriminator="kind"),
]


KINDS = frozenset({"points", "pose", "camera", "angle", "distance", "plane", "sphere", "socket"})


class KnownDistanceTable(Table):
    between: tuple[Name, Name]
    mm: Positive
    sigma_mm: Positive


class GravityTable(Table):
    m_s2: Annotated[Vector, AfterValidator(_gravity)] = (0.0, 0.0, -9.80665)


class PayloadTable(Table):
    mass_kg: Mass = 0.0
    com_mm: Vector = (0.0, 0.0, 0.0)


class LoadTable(Table):
    mass_kg: Mass
    com_mm: Vector
    max_tilt_deg: Annotated[Number, Field(ge=0, le=90)] = 90.0


class LevelsTable(Table):
    poses_per_level: Count
    count: Count | None = None
    min_separation_deg: NotNegative = 0.0
    values_deg: list[Number] | None = None


class Box(Table):
    type: Literal["box"]
    center_mm: Vector
    size_mm: tuple[Positive, Positive, Positive]
    rpy_deg: Vector = (0.0, 0.0, 0.0)


class Sphere(Table):
    type: Literal["sphere"]
    center_mm: Vector
    radius_mm: Positive


class HalfSpace(Table):
    type: Literal["halfspace"]
    point_mm: Vector
    normal: Direction


def _kind_of_floor(value: Any) -> str:
    return "none" if value is False else "number"


FloorHeight = Annotated[
    Annotated[Number, Tag("number")] | Annotated[Literal[False], Tag("none")],
    Discriminator(_kind_of_floor),
]


class DesignTable(Table):
    poses: Count | None = None
    levels: dict[str, LevelsTable] = {}
    targets: str | None = None
    repeats: Annotated[bool, Strict()] = False
    reference_every: Count | None = None
    reapproaches: Count | None = None
    floor_mm: FloorHeight | None = None
    obstacle: list[Annotated[Box | Sphere | HalfSpace, Field(discriminator="type")]] = []


class DiagnosisTable(Table):
    exclude: list[str] = []


class PriorTable(Table):
    file: Annotated[str, Field(min_length=1)]


class AcceptanceTable(Table):
    tolerance_mm: Positive
    rule: Literal["simple", "guarded"] = "guarded"


def _told(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, str | int | float | date | time):
        raise ValueError("is no text, number or date")
    if len(str(value)) > _LONGEST_TEXT or not str(value).isprintable():
        raise ValueError(f"is no line of text, of {_LONGEST_TEXT} characters at most")
    return value


Told = Annotated[Any, AfterValidator(_told)]
"""What a reader is told as it stands."""


class ModelTable(Table):
    effects: Annotated[list[str], Field(min_length=1)]
    knots_deg: dict[str, list[Number]] = {}
    prior: PriorTable | None = None


class CellFile(Table):
    """The whole file."""

    format: Literal[1] = Field(alias="schema")
    name: Name | None = None
    robot: RobotTable
    markers_mm: dict[Name, Marker] = {}
    bodies: dict[Name, BodyTable] = {}
    boards: dict[Name, BoardTable] = {}
    instrument: InstrumentTable | None = None
    instruments: dict[Name, AnyInstrument] = {}
    known_distances: list[KnownDistanceTable] = []
    gravity: GravityTable = GravityTable()
    payload: PayloadTable = PayloadTable()
    load: LoadTable | None = None
    design: DesignTable = DesignTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
    acceptance: AcceptanceTable | None = None
    report: dict[Name, Told] = {}
    model: ModelTable

    @model_validator(mode="after")
    def _load_once(self) -> Self:
        own, load = self.payload, self.load
        if load is None or not own.mass_kg or own.com_mm != load.com_mm:
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
        kinds = {entry.kind for entry in self.instruments.values()} or {"points"}
        touching = kinds - {"pose", "camera"}
        if touching and not self.markers_mm:
            raise ValueError(f"reads {min(touching)} and has no [markers_mm]; add what is read")
        if "pose" in kinds and not self.bodies:
            raise ValueError("reads pose and has no [bodies]; add what is read")
        if self.bodies and "pose" not in kinds:
            raise ValueError("has [bodies] and no instrument of kind pose that reads them")
        if self.markers_mm and not touching and not self._cameras("world"):
            raise ValueError("has [markers_mm] and no instrument that reads them")
        self._check_boards()
        return self

    def _cameras(self, on: str) -> list[str]:
        tables = self.instruments.items()
        return [name for name, own in tables if isinstance(own, CameraTable) and own.on == on]

    def _check_boards(self) -> None:
        """Each camera sees what stands on the other side, and each board is seen."""
        boards = {
            on: [n for n, own in self.boards.items() if own.on == on] for on in ("tip", "world")
        }
        if (seeing := self._cameras("world")) and not boards["tip"] and not self.markers_mm:
            raise ValueError(
                f"has camera {seeing[0]} in the world and nothing on the tip; add [boards.NAME] with "
                "on = 'tip', or [markers_mm]"
            )
        if (seeing := self._cameras("tip")) and not boards["world"]:
            raise ValueError(
                f"has camera {seeing[0]} on the tip and nothing in the world; add [boards.NAME] with "
                "on = 'world'"
            )
        for on, other in (("tip", "world"), ("world", "tip")):
            if boards[on] and not self._cameras(other):
                raise ValueError(
                    f"has board {boards[on][0]} on the {on} and no camera on the {other} that sees it"
                )
        named = [*self.markers_mm, *self.bodies, *self.boards, *self._cameras("tip")]
        if len(named) > len(set(named)):
            twice = next(name for name in named if named.count(name) > 1)
            raise ValueError(f"{twice!r} names two things; rename one")
