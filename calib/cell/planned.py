"""Parts of a cell whose tables are these very objects: [design], [timing], [load]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.instruments.protocol import TIP
from calib.keys import (
    DEG,
    MM,
    STRICT,
    Count,
    Direction,
    Flag,
    Mass,
    Name,
    NotNegative,
    NotNegativeMetres,
    Number,
    Place,
    Point,
    Positive,
    PositiveMetres,
    Vector,
    Written,
    key,
    times,
)
from calib.motion.filtering import CUTOFF
from calib.poses import Poses


@dataclass(frozen=True)
class Repeatability:
    """How the arm scatters from one approach of a pose to the next: one standard deviation of one
    coordinate of the tip [m], and of one component of its rotation [rad].
    """

    translation: float
    rotation: float


@dataclass(frozen=True)
class MotionKeys:
    """What motions are read by.

    cutoff : float, Hz, of the filter; constants : dict, joint -> torque at the joint of one ampere, N m
    effects : tuple of str, ``name`` or ``name:where[,where]``, terms of the torque in the model
    excluded : tuple of str, terms that this robot cannot have
    """

    cutoff: float = CUTOFF
    constants: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()


@dataclass(frozen=True)
class Load:
    """The load of a plan: mass [kg], place [m], largest tilt [rad], and the link on which it hangs."""

    __pydantic_config__ = STRICT
    mass: Annotated[Mass, key("mass_kg")]
    """test load, hung on for the second reading of each pose of a plan; measured data contain it as
    wrench"""
    com: Annotated[Place, key("com_mm")]
    """where it hangs, in the frame of its link"""
    max_tilt: Annotated[Number, Field(ge=0, le=90), times(DEG), key("max_tilt_deg")] = np.pi / 2
    """largest angle between the x axis of that link and the horizontal"""
    on: Name = TIP
    """link on which it hangs, and measured wrenches act, where that is not the tip"""


@dataclass(frozen=True, eq=False)
class AskedLevels:
    """Levels of one joint [rad or m] at which the poses of a plan stand: given values, or how many.

    values : ndarray, shape (count,); None where they are to be chosen
    """

    __pydantic_config__ = STRICT
    per_level: Annotated[Count, key("poses_per_level")]
    """poses at each level"""
    count: Count | None = None
    """number of levels; their angles are chosen"""
    values: Annotated[
        Annotated[Array, Written(list[Number], lambda given: np.sort(given) * DEG)] | None,
        key("values_deg"),
    ] = None
    """given levels"""
    separation: Annotated[NotNegative, times(DEG), key("min_separation_deg")] = 0.0
    """smallest distance between chosen levels"""

    def in_millimetres(self) -> AskedLevels:
        """The same of a joint that slides, of which ``_deg`` stands for millimetres."""
        values = None if self.values is None else self.values / DEG * MM
        return AskedLevels(self.per_level, self.count, values, self.separation / DEG * MM)


@dataclass(frozen=True, eq=False, match_args=False)
class Box:
    """centre, half : ndarray, shape (3,), m, half its size; rpy : ndarray, shape (3,), rad."""

    __pydantic_config__ = STRICT
    __match_args__ = ("T_base_box", "half")
    centre: Annotated[Point, key("center_mm")]
    """box, sphere: centre, in the base's frame"""
    half: Annotated[
        Array,
        Written(tuple[Positive, Positive, Positive], lambda edges: np.array(edges) * (0.5 * MM)),
        key("size_mm"),
    ]
    """box: lengths of its edges"""
    rpy: Annotated[Array, Written(Vector, np.radians), key("rpy_deg")] = field(
        default_factory=lambda: np.zeros(3)
    )
    """box: orientation"""
    type: Literal["box"] = "box"
    """its form"""

    @property
    def T_base_box(self) -> Array:
        """Where it stands, shape (4, 4), m."""
        return from_xyz_rpy(self.centre, self.rpy)


@dataclass(frozen=True, eq=False)
class Ball:
    """centre : ndarray, shape (3,), m; radius : float, m."""

    __pydantic_config__ = STRICT
    centre: Annotated[Point, key("center_mm")]
    """box, sphere: centre, in the base's frame"""
    radius: Annotated[PositiveMetres, key("radius_mm")]
    """sphere: radius"""
    type: Literal["sphere"] = "sphere"
    """its form"""


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """All that lies beyond the plane through a point (3,), m, on the side of its normal (3,)."""

    __pydantic_config__ = STRICT
    point: Annotated[Point, key("point_mm")]
    """halfspace: a point of its plane"""
    normal: Annotated[Array, Written(Direction, np.array)]
    """halfspace: direction to the forbidden side"""
    type: Literal["halfspace"] = "halfspace"
    """its form"""


Body: TypeAlias = Box | Ball | HalfSpace
"""What stands still around the arm, in the base frame."""
_Obstacle = Annotated[Body, Field(discriminator="type")]


@dataclass(frozen=True, eq=False)
class Targets:
    """Poses at which accuracy is wanted.

    path : Path of their table; poses : Poses; weights : ndarray, shape (m,)
    """

    path: Path
    poses: Poses
    weights: Array


@dataclass(frozen=True, eq=False)
class Planned:
    """Defaults of a design, in m and s; below each field stands what its key holds."""

    __pydantic_config__ = STRICT
    poses: Count | None = None
    """number of poses"""
    levels: Annotated[Mapping[str, AskedLevels], Written(dict[str, AskedLevels], dict)] = field(
        default_factory=dict
    )
    """angles of one joint that poses of a plan share"""
    targets: Annotated[Targets | None, Written(str, str)] = None  # a name until they are read
    """table of target poses (posecal explain columns)"""
    targets_after: Annotated[
        Annotated[NotNegative, times(3600.0)] | None, key("targets_after_h")
    ] = None
    """hours from the last reading to the work at the targets; the end of the day without it"""
    repeats: Flag = False
    """whether a pose may be chosen twice"""
    reapproaches: Count | None = None
    """number of repeat visits (posecal explain design)"""
    obstacles: Annotated[tuple[Body, ...], Written(list[_Obstacle], tuple), key("obstacle")] = ()
    """bodies that the arm must not touch (posecal explain constraints)"""
    margin: Annotated[NotNegativeMetres, key("margin_mm")] = 0.0
    """distance that the arm keeps of obstacles, at the poses and between them"""


@dataclass(frozen=True)
class Pace:
    """How long a day takes; s, and speed as a share."""

    __pydantic_config__ = STRICT
    speed: Annotated[Positive, Field(le=100), times(0.01), key("speed_percent")] = 0.1
    """share of the joints' largest speeds and accelerations at which the arm goes from pose to pose"""
    settle: Annotated[NotNegative, key("settle_s")] = 2.0
    """wait at each pose before it is read"""
    reading: Annotated[NotNegative, key("read_s")] = 10.0
    """time of one reading"""
    load: Annotated[NotNegative, times(60.0), key("load_change_min")] = 120.0
    """time to hang the load, or to take it off"""

    def standing(self, loaded: bool) -> float:
        """Time at a pose [s]; loaded : whether it is also read with the load, hung there."""
        return self.settle + self.reading * (1 + loaded) + 2.0 * self.load * loaded
