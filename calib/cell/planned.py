"""What a cell says of the plans to be made: the [design] table, in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from calib.arrays import Array
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class AskedLevels:
    """Levels of one joint at which the poses of a plan are to stand: given values, or how many.

    per_level : int, poses at each level; count : int, levels to choose, or None where they are given
    values : ndarray, shape (count,), rad or m, or None where they are to be chosen
    separation : float, rad or m, least distance of two chosen levels
    """

    per_level: int
    count: int | None = None
    values: Array | None = None
    separation: float = 0.0


@dataclass(frozen=True, eq=False)
class Box:
    """T_base_box : ndarray, shape (4, 4); half : ndarray, shape (3,), m, half its size."""

    T_base_box: Array
    half: Array


@dataclass(frozen=True, eq=False)
class Ball:
    """centre : ndarray, shape (3,), m; radius : float, m."""

    centre: Array
    radius: float


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """All that lies beyond the plane through a point (3,), m, on the side of its normal (3,)."""

    point: Array
    normal: Array


Body: TypeAlias = Box | Ball | HalfSpace
"""What stands still around the arm, in the base frame."""


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
    """Defaults of a design.

    poses : int or None, how many; levels : dict, joint -> AskedLevels; targets : Targets or None
    targets_after : float or None, s after the last reading at which the arm comes to them; None where
        nobody says, which counts as the end of the day
    repeats : bool, whether a pose may be measured more than once
    reapproaches : int or None, poses that are visited again
    obstacles : tuple of Body, in the order of the file
    floor : float or None, m, height above which the arm keeps; None where there is none
    margin : float, m, distance that the arm keeps of floor and obstacles
    """

    poses: int | None = None
    levels: Mapping[str, AskedLevels] = field(default_factory=dict)
    targets: Targets | None = None
    targets_after: float | None = None
    repeats: bool = False
    reapproaches: int | None = None
    obstacles: tuple[Body, ...] = ()
    floor: float | None = None
    margin: float = 0.0


@dataclass(frozen=True)
class Pace:
    """How long a day takes: the [timing] table.

    speed : float, share of the joints' speeds and accelerations at which the arm goes from pose to pose
    settle : float, s, that it waits there; reading : s, that one reading takes
    load : float, s, that hanging the load, or taking it off, takes
    """

    speed: float = 0.1
    settle: float = 2.0
    reading: float = 10.0
    load: float = 120.0

    def standing(self, loaded: bool) -> float:
        """Time at a pose [s]; loaded : whether it is also read with the load, hung there."""
        return self.settle + self.reading * (1 + loaded) + 2.0 * self.load * loaded
