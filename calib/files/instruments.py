"""The instruments of a cell file: tables of millimetres to objects in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arm.se3 import from_xyz_rpy, inverse, so3_log
from calib.arrays import Array
from calib.errors import InputError
from calib.files.boards import shape_of
from calib.files.schema import (
    DIVISORS,
    AngleTable,
    BoardTable,
    BodyTable,
    CameraTable,
    CellFile,
    CommonTable,
    DistanceTable,
    InstrumentTable,
    IntrinsicsStd,
    LimitTable,
    MpeSigma,
    PlaneTable,
    PolarSigma,
    PoseTable,
    Sigma,
    SocketTable,
    SphereTable,
)
from calib.instruments import (
    Angle,
    ArmCamera,
    Camera,
    Distance,
    FixedCamera,
    Instrument,
    KnownDistance,
    Plane,
    Pose,
    Socket,
    Sphere,
    Tracker,
)
from calib.instruments.camera import FREE, Board
from calib.instruments.common_errors import COMMON_KINDS, CommonError
from calib.instruments.lens import Lens
from calib.instruments.plane import place_of
from calib.instruments.pose import CORNERS, corners_of
from calib.noise import Noise

_MM = 1e-3
_URAD = 1e-6


_LARGEST_BOARD = 50.0  # m


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a cell as markers that follow its own: frames, boards and cameras on the tip.

    parts : dict, name -> slice, positions of its points; names : tuple of str, of all of these markers
    markers : ndarray, shape (k, 3), m, tip frame
    shapes : dict, board -> names and points (n, 3), m, in its frame, of those on the tip and others
    """

    parts: Mapping[str, slice]
    names: tuple[str, ...]
    markers: Array
    shapes: Mapping[str, tuple[tuple[str, ...], Array]]


def bodies_of(path: Path, table: CellFile) -> Bodies:
    """The bodies after the markers; one of which nothing is said is guessed at the tip frame.

    Raises InputError for a board of which no point can be.
    """
    shapes = {name: _shape(path, name, board) for name, board in table.boards.items()}
    frames: dict[str, BodyTable] = dict(table.bodies)
    frames |= {
        name: own
        for name, own in table.instruments.items()
        if isinstance(own, CameraTable) and own.on == "tip"
    }
    parts: dict[str, slice] = {}
    names: list[str] = []
    points: list[Array] = [np.zeros((0, 3))]
    first = len(table.markers_mm)
    for name, body in frames.items():
        parts[name] = slice(first + len(names), first + len(names) + CORNERS)
        names += [name + end for end in ("", ":x", ":y")]
        points.append(_corners(body))
    for name, board in table.boards.items():
        if board.on == "tip":
            own, shape = shapes[name]
            parts[name] = slice(first + len(names), first + len(names) + len(own))
            names += own
            points.append(_laid(board, shape))
    return Bodies(parts, tuple(names), np.concatenate(points), shapes)


def _shape(path: Path, name: str, board: BoardTable) -> tuple[tuple[str, ...], Array]:
    """Names and points of a board; one that lies where no board reaches is none of it."""
    names, points = shape_of(board)
    near = np.abs(points - np.median(points, axis=0)).max(axis=1) < _LARGEST_BOARD
    if not near.any():
        raise InputError(
            path,
            f"boards.{name}.points_mm",
            "lie farther apart than those of any board",
            "give them in mm",
        )
    kept = [point for point, own in zip(names, near, strict=True) if own]
    return tuple(f"{name}:{point}" for point in kept), points[near]


def _laid(table: BodyTable, points: Array) -> Array:
    T = from_xyz_rpy(np.array(table.position_mm) * _MM, np.radians(table.rpy_deg))
    return points @ T[:3, :3].T + T[:3, 3]


def _corners(table: BodyTable) -> Array:
    T = from_xyz_rpy(np.array(table.position_mm) * _MM, np.radians(table.rpy_deg))
    return corners_of(T[:3, :3], T[:3, 3])


def instruments_of(
    table: CellFile, markers: Sequence[str], bodies: Bodies
) -> tuple[Instrument, ...]:
    """All of them; sockets of one uncertainty are one instrument that stands elsewhere each time."""
    if table.instrument is not None:
        return (_tracker(table.instrument, "instrument", None),)
    own = tuple(range(len(markers))) if bodies.parts else None
    placed = "base" in table.model.effects
    found: list[Instrument] = []
    groups: dict[float, list[tuple[str, SocketTable]]] = {}
    for name, entry in table.instruments.items():
        if isinstance(entry, PoseTable):
            found.append(_pose(entry, name, [bodies.parts[own] for own in table.bodies]))
        elif isinstance(entry, CameraTable):
            found.append(_camera(entry, name, table, bodies))
        elif isinstance(entry, AngleTable):
            found.append(Angle(name=name, markers=own, sigma=entry.sigma_urad * _URAD))
        elif isinstance(entry, InstrumentTable):
            found.append(_tracker(entry, name, own))
        elif isinstance(entry, SocketTable):
            groups.setdefault(entry.sigma_mm, []).append((name, entry))
        else:
            found.append(replace(_touching(entry, placed), name=name, markers=own))
    found += [_sockets(group, own) for group in groups.values()]
    return tuple(found)


def _sockets(group: Sequence[tuple[str, SocketTable]], reads: tuple[int, ...] | None) -> Socket:
    """Foreseen where the places of all of them are given."""
    names = tuple(name for name, _ in group)
    given = [table.position_mm for _, table in group if table.position_mm is not None]
    return Socket(
        name=names[0],
        markers=reads,
        sites=names if len(names) > 1 else (),
        sigma=group[0][1].sigma_mm * _MM,
        standing=np.array(given) * _MM if len(given) == len(group) else None,
    )


def _touching(table: DistanceTable | PlaneTable | SphereTable, placed: bool) -> Instrument:
    """placed : whether the model has places of instruments: what is given of them is a guess."""
    sigma = table.sigma_mm * _MM
    if isinstance(table, DistanceTable):
        anchor = None if table.anchor_mm is None else np.array(table.anchor_mm) * _MM
        known = anchor is not None and not placed
        nearest, farthest = table.reach_mm or (0.0, math.inf)
        reach = (nearest * _MM, farthest * _MM)
        return Distance(sigma=sigma, anchor=anchor, known=known, offset=table.offset, reach=reach)
    if isinstance(table, PlaneTable):
        return Plane(sigma=sigma, standing=_of_plane(table))
    radius = None if table.radius_mm is None else table.radius_mm * _MM
    return Sphere(sigma=sigma, radius=radius, standing=_of_sphere(table))


def _of_plane(table: PlaneTable) -> Array | None:
    if table.position_mm is None or table.normal is None:
        return None
    return place_of(np.array(table.position_mm) * _MM, np.array(table.normal))[None]


def _of_sphere(table: SphereTable) -> Array | None:
    """Its middle, and its radius where that is to be found."""
    if table.position_mm is None or (table.radius_mm or table.about_radius_mm) is None:
        return None
    about = () if table.radius_mm is not None else (table.about_radius_mm,)
    return np.array([[*table.position_mm, *about]]) * _MM


def _tracker(table: InstrumentTable, name: str, reads: tuple[int, ...] | None) -> Tracker:
    stands = None if table.position_mm is None else np.array(table.position_mm) * _MM
    return Tracker(
        name=name,
        markers=reads,
        noise=_noise(table.sigma_mm),
        stands=stands,
        common=_common(table.common),
    )


def _common(table: CommonTable) -> tuple[CommonError, ...]:
    """The errors that a cell states; a number is one standard uncertainty."""
    found = []
    for key, kind in COMMON_KINDS.items():
        stated = getattr(table, key)
        if isinstance(stated, LimitTable):
            divisor = stated.divisor or DIVISORS[stated.distribution]
            freedom = stated.degrees_of_freedom or math.inf
            limit = stated.limit * kind.scale
            found.append(CommonError(key, limit, stated.distribution, divisor, freedom))
        elif stated:
            found.append(CommonError(key, stated * kind.scale))
    return tuple(found)


def _camera(table: CameraTable, name: str, cell: CellFile, bodies: Bodies) -> Camera:
    """One that sees all boards on the other side, one in the world the markers too."""
    on_tip = table.on == "tip"
    boards: list[Board] = []
    first = 0 if on_tip else len(cell.markers_mm)
    for own, (_, points) in bodies.shapes.items():
        if cell.boards[own].on != table.on:
            boards.append(Board(own, slice(first, first + len(points)), points))
            first += len(points)
    reads = list(range(len(cell.markers_mm)))
    if on_tip:
        reads = [*range(bodies.parts[name].start, bodies.parts[name].stop)] * first
    for board in () if on_tip else boards:
        reads += range(bodies.parts[board.name].start, bodies.parts[board.name].stop)
    targets = [point for board in boards for point in bodies.shapes[board.name][0]]
    believed = _believed(table.intrinsics_std or IntrinsicsStd())
    free = np.isfinite(believed)
    for part in table.free:
        free[FREE[part]] = True
    focal = table.focal_px if isinstance(table.focal_px, tuple) else (table.focal_px,) * 2
    return (ArmCamera if on_tip else FixedCamera)(
        name=name,
        markers=tuple(reads),
        targets=tuple(targets) if on_tip else (),
        lens=Lens(np.array([*focal, *table.center_px, *(*table.distortion, 0.0)[:5]])),
        sigma=table.sigma_px,
        image=None if table.image_px is None else np.array(table.image_px),
        free=np.flatnonzero(free),
        believed=believed,
        boards=tuple(boards),
        standing=_standing(table, [cell.boards[board.name] for board in boards]),
    )


def _standing(table: CameraTable, boards: Sequence[BoardTable]) -> Array | None:
    """The place of a camera in the world, or of the boards that one on the tip sees, if given."""
    in_world: list[BodyTable] = [*boards] if table.on == "tip" else [table]
    if not all({"position_mm", "rpy_deg"} & own.model_fields_set for own in in_world):
        return None
    places = [
        from_xyz_rpy(np.array(own.position_mm) * _MM, np.radians(own.rpy_deg)) for own in in_world
    ]
    if table.on == "world":
        places = [inverse(places[0])]
    return np.concatenate([np.concatenate([T[:3, 3], so3_log(T[:3, :3])]) for T in places])


def _believed(given: IntrinsicsStd | list[float]) -> Array:
    """Standard deviations of a lens's values, shape (9,), NaN where none is given."""
    found = np.full(9, np.nan)
    if isinstance(given, list):
        found[: len(given)] = given
        return found
    parts = zip(FREE.values(), (given.focal_px, given.center_px, given.distortion), strict=True)
    for part, std in parts:
        if std is not None:
            several = [*std, *std[-1:] * 5] if isinstance(std, list) else [std] * 5
            found[part] = several[: part.stop - part.start]
    return found


def _pose(table: PoseTable, name: str, bodies: Sequence[slice]) -> Pose:
    reads = tuple(i for own in bodies for i in range(own.start, own.stop))
    units = np.repeat([_MM, _URAD], 3)
    if table.covariance is not None:
        covariance = np.array(table.covariance) * np.outer(units, units)
    else:
        sigma = np.repeat([table.sigma_mm or math.nan, table.sigma_urad or math.nan], 3)
        covariance = np.diag((sigma * units) ** 2)
    alone = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    return Pose(name=name, markers=reads, noise=Noise.isotropic(alone), covariance=covariance)


def _noise(sigma: Sigma) -> Noise:
    if isinstance(sigma, PolarSigma):
        return Noise(
            sigma.range_mm * _MM,
            sigma.transverse_mm * _MM,
            sigma.range_mm_per_m * _MM,
            sigma.transverse_mm_per_m * _MM,
        )
    if isinstance(sigma, MpeSigma):
        return Noise.maximum_permissible(
            sigma.mpe_mm * _MM, sigma.mpe_mm_per_m * _MM, sigma.divisor
        )
    return Noise.isotropic(sigma * _MM)


def known_distances(path: Path, table: CellFile) -> tuple[KnownDistance, ...]:
    """Those of the cell. Raises InputError where one is not between two sockets or two markers."""
    sockets = {name for name, own in table.instruments.items() if own.kind == "socket"}
    found = []
    for number, own in enumerate(table.known_distances):
        a, b = own.between
        alike = any(a in names and b in names for names in (sockets, set(table.markers_mm)))
        if a == b or not alike:
            known = ", ".join([*sorted(sockets), *table.markers_mm][:12])
            raise InputError(
                path,
                f"known_distances.{number}.between",
                f"{a!r} and {b!r} are not two sockets or two markers of the cell",
                f"those are {known}",
            )
        found.append(KnownDistance((a, b), own.mm * _MM, own.sigma_mm * _MM))
    return tuple(found)
