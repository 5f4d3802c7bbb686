"""How readings err by what a cell says: plain standard deviations, and draws by them.

Readings that were drawn by the weights of the fits would bear out any weights, wrong ones too. So none
of the package's noise, whitening or covariance enters here, but the tables of ``cell.toml`` alone, or
the numbers of a cell that was made without a text.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell, Repeatability
from calib.instruments import Instrument, Pose, Tracker
from calib.instruments.camera import Camera
from calib.instruments.detection import Board

_MM, _URAD = 1e-3, 1e-6
_UNITS = {"sigma_mm": _MM, "sigma_urad": _URAD}


class ErrorModel(Protocol):
    """How the readings of one instrument err."""

    def errors(self, white: Array, exact: Array, start: Array) -> Array:
        """Errors (..., m, C, r), SI, made of white noise of that shape.

        exact : ndarray, shape (m, C, r), readings without noise
        start : ndarray, shape (m, C, r), where the beams start, in the frame of the readings
        """
        ...


@dataclass(frozen=True)
class IsotropicError:
    """Every number by itself, all by one standard deviation, in the unit of the readings in SI."""

    sigma: float

    def errors(self, white: Array, exact: Array, start: Array) -> Array:
        del exact, start
        return self.sigma * white


@dataclass(frozen=True)
class BeamError:
    """A point along and across its beam: standard deviations (m, m for each metre of range)."""

    along: tuple[float, float]
    across: tuple[float, float]

    def errors(self, white: Array, exact: Array, start: Array) -> Array:
        beams = exact - start
        ranges = np.linalg.norm(beams, axis=-1, keepdims=True)
        unit = beams / np.where(ranges > 0.0, ranges, 1.0)
        ahead = (white * unit).sum(axis=-1, keepdims=True) * unit
        along, across = (a + b * ranges for a, b in (self.along, self.across))
        return np.asarray(along * ahead + across * (white - ahead))


@dataclass(frozen=True, eq=False)
class BodyError:
    """A frame by a displacement in its own axes; covariance : ndarray, shape (6, 6), m and rad."""

    covariance: Array

    def errors(self, white: Array, exact: Array, start: Array) -> Array:
        """Of rows that hold origin, x axis and y axis: what the frame displaced has beyond them."""
        del start
        moved = white[..., :6] @ np.linalg.cholesky(self.covariance).T
        x, y = exact[..., 3:6], exact[..., 6:]
        R = np.stack([x, y, np.cross(x, y)], axis=-1)
        turned = R @ rotation(moved[..., 3:]) - R
        shift = (R @ moved[..., :3, None])[..., 0]
        return np.concatenate([shift, turned[..., 0], turned[..., 1]], axis=-1)


@dataclass(frozen=True, eq=False)
class PixelError:
    """Both coordinates of a point in an image alike, more where its board looks small or leans.

    sigma : float, px, of large figures; boards : tuple of Board, with the numbers of their points
    """

    sigma: float
    boards: tuple[Board, ...]

    def errors(self, white: Array, exact: Array, start: Array) -> Array:
        """A figure as small as a detector finds it errs sqrt(5) times as much as a large one."""
        del start
        sigma = np.full(exact.shape[:-1], self.sigma)
        for board in self.boards:
            if board.printed:
                paper = np.column_stack([board.points[:, :2], np.ones(len(board.points))])
                for image, own in zip(
                    exact[:, board.channels], sigma[:, board.channels], strict=True
                ):
                    to_pixels = np.linalg.lstsq(paper, image)[0][:2]
                    side = board.printed * np.linalg.svd(to_pixels, compute_uv=False)[-1]
                    own *= np.sqrt(1.0 + (2.0 * min(board.square / side, 2.0)) ** 2)
        return sigma[..., None] * white


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """How instruments and arm err.

    of : name of an instrument -> how its readings err
    stands : name -> ndarray, shape (3,), m, base axes, where beams start; else at the readings' origin
    arm : standard deviations of the tip from one approach to the next, m and rad, zero where none
    """

    of: Mapping[str, ErrorModel]
    stands: Mapping[str, Array]
    arm: tuple[float, float] = (0.0, 0.0)


def stated_noise(path: Path, instruments: Sequence[Instrument] = ()) -> StatedNoise:
    """What the text of a cell, which :func:`calib.load_cell` takes, says of noise.

    instruments : of the cell; of them the points of boards are used, which the text does not list
    """
    text = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    tables = text.get("instruments") or {"instrument": text["instrument"]}
    stands = {
        name: np.array(table["position_mm"]) * _MM
        for name, table in tables.items()
        if table.get("kind", "points") == "points" and "position_mm" in table
    }
    robot = text["robot"]
    arm = robot.get("repeatability_mm", 0.0) * _MM, robot.get("repeatability_urad", 0.0) * _URAD
    boards = {i.name: i.boards for i in instruments if isinstance(i, Camera)}
    errs = {name: _error_model(table, boards.get(name, ())) for name, table in tables.items()}
    return StatedNoise(errs, stands, arm)


def _error_model(table: Mapping[str, Any], boards: tuple[Board, ...]) -> ErrorModel:
    if table.get("kind") == "pose":
        return BodyError(_of_body(table))
    sigma = table.get("sigma_mm")
    if isinstance(sigma, Mapping):
        return BeamError(*_by_range(sigma))
    if "sigma_px" in table:
        return PixelError(table["sigma_px"], boards)
    return next(IsotropicError(table[key] * unit) for key, unit in _UNITS.items() if key in table)


def _of_body(table: Mapping[str, Any]) -> Array:
    """Its covariance, from mm and urad."""
    units = np.repeat([_MM, _URAD], 3)
    if "covariance" in table:
        return np.array(table["covariance"]) * np.outer(units, units)
    return np.diag((np.repeat([table["sigma_mm"], table["sigma_urad"]], 3) * units) ** 2)


def _by_range(sigma: Mapping[str, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Along and across: a constant and what a metre of range adds."""
    if "mpe_mm" in sigma:
        share = _MM / sigma["divisor"]
        even = sigma["mpe_mm"] * share, sigma.get("mpe_mm_per_m", 0.0) * share
        return even, even
    along, across = (
        (sigma[f"{key}_mm"] * _MM, sigma.get(f"{key}_mm_per_m", 0.0) * _MM)
        for key in ("range", "transverse")
    )
    return along, across


def displaced_at_visits(
    points: Array, origins: Array, visit: IntArray, white: Array, arm: tuple[float, float]
) -> Array:
    """Points of tips that are shifted, and turned about their origins, anew at each visit.

    points : ndarray, shape (m, M, 3), m; origins : ndarray, shape (m, M or 1, 3), m
    visit : ndarray of int, shape (m,); white : ndarray, shape (trials, visits, 6)
    Returns ndarray, shape (trials, m, M, 3), m.
    """
    shift, turn = arm[0] * white[:, visit, :3], rotation(arm[1] * white[:, visit, 3:])
    return (points - origins) @ np.swapaxes(turn, -1, -2) + origins + shift[:, :, None]


def rotation(vector: Array) -> Array:
    """Rotations (..., 3, 3) about vectors (..., 3), rad."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix()
    return np.asarray(turns.reshape(*vector.shape, 3))


def noise_of(cell: Cell) -> StatedNoise:
    """How instruments and arm err by the numbers of a cell that has no text."""
    stands = {
        i.name: i.stands
        for i in cell.instruments
        if isinstance(i, Tracker) and i.stands is not None
    }
    arm = cell.repeatability or Repeatability(0.0, 0.0)
    errs = {i.name: _error_model_of(i) for i in cell.instruments}
    return StatedNoise(errs, stands, (arm.translation, arm.rotation))


def _error_model_of(instrument: Instrument) -> ErrorModel:
    match instrument:
        case Pose():
            return BodyError(instrument.covariance)
        case Tracker(noise=own):
            return BeamError((own.along, own.along_per_m), (own.across, own.across_per_m))
        case Camera():
            return PixelError(instrument.sigma, instrument.boards)
    sigma: float = getattr(instrument, "sigma")  # noqa: B009 - of every other kind
    return IsotropicError(sigma)
