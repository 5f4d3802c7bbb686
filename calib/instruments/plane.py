"""A plane that the marker touches, or a dial gauge that reads the marker's height above it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from calib.arm.se3 import skew, so3_exp, so3_right_jacobian
from calib.arrays import Array, Mask
from calib.instruments.keys_table import KeysTable
from calib.instruments.protocol import ZERO, Linear, Nominal, ReadingColumn, Start, Unknown
from calib.instruments.touching import Surface, best, contacts
from calib.keys import MM, Direction, PositiveMetres, Vector, key

_UP = np.array([0.0, 0.0, 1.0])
_LEAST_TURN = 1e-3  # rad: of a normal from straight down, where two tilts are one


@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """``n p - height``, read as zero or by a gauge along the outward normal n, in base axes.

    The place is the normal's turn from upright, ``n = exp(rx, ry, 0) z``, and the height of the base's
    origin under it. A plane that is only touched has its normal upward.
    """

    kind: ClassVar[str] = "plane"
    given_by: ClassVar[str] = "position_mm and normal"
    rows: ClassVar[int] = 1
    loose: ClassVar[slice | None] = ZERO
    unknowns: ClassVar[tuple[Unknown, ...]] = (
        Unknown("rx", "mrad", 1e-3, 1e-2),
        Unknown("ry", "mrad", 1e-3, 1e-2),
        Unknown("height", "mm", 1e-3, 1e-2),
    )
    columns: ClassVar[tuple[ReadingColumn, ...]] = (ReadingColumn("d", "length", optional=True),)

    def linearise(self, place: Array, points: Array) -> Linear:
        turn = np.concatenate([place[..., :2], np.zeros_like(place[..., 2:3])], axis=-1)
        R = so3_exp(turn)
        by_turn = (-R @ skew(_UP) @ so3_right_jacobian(turn))[..., None, None, :, :2]
        normal = (R @ _UP)[..., None, None, None, :]
        under = place[..., 2:3] - place[..., 3:].sum(axis=-1, keepdims=True)
        rows = (points * normal[..., 0, :]).sum(axis=-1, keepdims=True) - under[..., None, None, :]
        one = np.ones((*rows.shape, 1))
        by_place = np.concatenate(
            [points[..., None, :] @ by_turn, -one, np.repeat(one, place.shape[-1] - 3, axis=-1)],
            axis=-1,
        )
        return Linear(rows, normal, by_place)

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """The plane that points lie in most (SVD), either side up, and that of the gauge's heights."""
        _, _, p = contacts(seen, arm)
        d, middle = rows[seen][:, 0], p.mean(axis=0)
        flat = np.linalg.svd(p - middle)[2][-1]
        normals = [flat * (1.0 if flat[2] >= 0.0 else -1.0)]
        if d.any():
            slope = np.linalg.lstsq(p - middle, d - d.mean(), rcond=1e-6)[0]
            length = float(np.linalg.norm(slope))
            normals += [-normals[0], *([slope / length] if length > 0.0 else [])]
        starts = [np.array([*_tilt(n), n @ middle - d.mean()]) for n in normals]
        given = [] if self.standing is None else [self.guess_at(self.name)]
        return best(self, rows, seen, arm, np.array([*given, *starts]))


def place_of(point: Array, normal: Array) -> Array:
    """The place (3,) of a plane through a point (3,), m, base axes; its normal (3,) is taken upward."""
    up = normal / np.linalg.norm(normal) * (1.0 if normal[2] >= 0.0 else -1.0)
    return np.array([*_tilt(up), up @ point])


def _tilt(normal: Array) -> tuple[float, float]:
    """rx and ry that turn the vertical into a normal (3,)."""
    across = float(np.hypot(normal[0], normal[1]))
    angle = float(np.arctan2(across, normal[2]))
    if across == 0.0:
        return (0.0, 0.0) if angle == 0.0 else (np.pi - _LEAST_TURN, 0.0)
    return -angle * float(normal[1]) / across, angle * float(normal[0]) / across


class PlaneTable(KeysTable):
    """A plane: its keys in a cell."""

    rides = False
    makes = Plane
    kind: Literal["plane"]
    sigma: Annotated[PositiveMetres, key("sigma_mm")]
    """one standard deviation of a length"""
    position_mm: Vector | None = None
    """plane: a point of it, in the base's frame"""
    normal: Direction | None = None
    """plane: outward normal; with position_mm plans know where to touch it"""

    @model_validator(mode="after")
    def _whole_plane(self) -> Self:
        if (self.position_mm is None) != (self.normal is None):
            raise ValueError("position_mm, a point of it, and normal go together")
        return self

    @property
    def fields(self) -> dict[str, Any]:
        if self.position_mm is None or self.normal is None:
            return {"sigma": self.sigma}
        place = place_of(np.array(self.position_mm) * MM, np.array(self.normal))
        return {"sigma": self.sigma, "standing": place[None]}
