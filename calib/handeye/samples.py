"""Samples of a hand-eye calibration: where the arm was, and where each image shows the target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import fit_rigid, inverse, skew, so3_exp, so3_log, so3_right_jacobian, transform
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.effects.tool import Body
from calib.errors import CalibError
from calib.instruments import ArmCamera, FixedCamera, Instrument, Pose
from calib.instruments.pose import rotation_of
from calib.instruments.posit import refined
from calib.instruments.riding import CORNERS, taken
from calib.model import Model
from calib.poses import Measurements, Poses

Eye: TypeAlias = Literal["in-hand", "on-base"]
LEAST = 4
"""Points by which an image shows where the target is."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A camera and a target that it sees.

    instrument : Instrument that reads them; part : slice, its readings of the target among all
    points : ndarray, shape (n, 3), m, of the target, in its frame; none where whole poses are read
    """

    camera: str
    target: str
    eye: Eye
    instrument: Pose | ArmCamera | FixedCamera
    part: slice
    points: Array

    @property
    def carrier(self) -> Literal["tip", "base"]:
        """On what the camera sits."""
        return "tip" if self.eye == "in-hand" else "base"

    def carried(self, model: Model, poses: Poses) -> Array:
        """F: the camera's carrier from what carries the target, by the nominal arm, (m, 4, 4)."""
        frames = forward(model.robot, poses.q)
        tip = transform(frames.R[:, -1], frames.o[:, -1])
        return tip if self.eye == "in-hand" else inverse(tip)

    def predicted(self, model: Model, values: Array, poses: Poses) -> Array:
        """C by a model, shape (m, 4, 4)."""
        if isinstance(self.instrument, Pose):
            return self._turned(model.predict(values, poses)[:, self.part.start])
        points = model.tip_points(model.state(values, poses).frames, values, poses)
        placed = self.instrument.found_at(values[self._place(model)])
        seen = placed.viewed(taken(placed, points))
        if seen is None:
            return np.full((len(poses), 4, 4), np.nan)
        first = next(part for one, part in model.readout.channels.blocks if one is self.instrument)
        here = slice(self.part.start - first.start, self.part.stop - first.start)
        return fit_rigid(seen[:, here], self.points)

    def measured(self, data: Measurements, first: Array) -> tuple[Array, Mask]:
        """C as each image shows it by itself, (m, 4, 4), and which images do, (m,).

        first : ndarray, shape (m, 4, 4), from where the errors of an image's rays are made least
        """
        rows, seen = data.readings[:, self.part], data.seen[:, self.part]
        if isinstance(self.instrument, Pose):
            return self._turned(rows[:, 0]), seen[:, 0]
        enough, C = seen.sum(axis=1) >= LEAST, first.copy()
        ideal = self.instrument.lens.ideal(rows[enough][..., :2])
        R, t = first[enough, :3, :3], first[enough, :3, 3]
        C[enough] = transform(*refined(ideal, seen[enough], self.points, R, t)[:2])
        return C, np.asarray(enough & np.isfinite(C).all(axis=(1, 2)))

    def _turned(self, rows: Array) -> Array:
        """C of readings (m, 9) of poses: of a camera in the hand that is read, the other way round."""
        T = transform(rotation_of(rows), rows[..., :3])
        return inverse(T) if self.eye == "in-hand" else T

    def _place(self, model: Model) -> slice:
        """Of the instrument, among the values."""
        bases = model.readout.bases
        return next(part for base, part in bases if base.of.name == self.instrument.name)

    def standing(self, model: Model, values: Array) -> tuple[Array, Array]:
        """E, shape (4, 4), and how it follows the values, shape (6, p).

        Rows are x, y, z along the axes of the carrier, m, then the turn about those of the camera, rad.
        """
        return self._in_hand(model, values) if self.eye == "in-hand" else self._fixed(model, values)

    def _fixed(self, model: Model, values: Array) -> tuple[Array, Array]:
        """The inverse of the instrument's place: ``p = -R^T t``, and R turns by what r does."""
        part = self._place(model)
        t, r = values[part][:3], values[part][3:6]
        R, turn = so3_exp(r), so3_right_jacobian(r)
        E = transform(R.T, -R.T @ t)
        by = np.zeros((6, len(values)))
        by[:3, part.start : part.start + 3] = -R.T
        by[:3, part.start + 3 : part.start + 6] = skew(E[:3, 3]) @ turn
        by[3:, part.start + 3 : part.start + 6] = -R @ turn
        return E, by

    def _in_hand(self, model: Model, values: Array) -> tuple[Array, Array]:
        """Three points of the body: its origin, and its axes, which turn by what r does."""
        name = f"body:{self.camera}"
        effect, part = next(
            (e, p) for e, p in model.parts if isinstance(e, Body) and e.where == name
        )
        origin, x, y = model.marker_positions(values)[effect.markers][:CORNERS]
        axes = rotation_of(np.concatenate([origin, x - origin, y - origin]))
        E = transform(axes, origin)
        r = np.zeros(6)
        r[list(effect.components)] = values[part]
        first = so3_exp(r[3:]).T @ axes  # of the guess
        whole = np.zeros((6, 6))
        whole[:3, :3] = np.eye(3)
        whole[3:, 3:] = first.T @ so3_right_jacobian(r[3:])
        by = np.zeros((6, len(values)))
        by[:, part] = whole[:, list(effect.components)]
        return E, by


def pairs_of(cell: Cell, data: Measurements, eye: Eye | None) -> tuple[Pair, ...]:
    """The pairs that the data hold.

    eye : where the camera is, of instruments that read whole poses; in the hand by default

    Raises CalibError where there is none, an instrument stands at several stations, or the robot has
    several tips.
    """
    if cell.robot.branched:
        raise CalibError(
            "a hand-eye calibration is of one arm, and here things ride on several links; use identify"
        )
    found = [
        pair
        for instrument, part in cell.channels.blocks
        for pair in _of(cell, instrument, part, eye)
        if data.seen[:, pair.part].any()
    ]
    if not found:
        raise CalibError(
            "no camera sees a board, and nothing reads poses of a body: a hand-eye calibration needs "
            "[instruments.NAME] of kind camera with [boards], or of kind pose with [bodies]"
        )
    if len(data.poses.stations) > 1:
        raise CalibError("poses are read from several stations; give a table of one station")
    for pair in found:
        if eye not in (None, pair.eye):
            on = "tip" if pair.eye == "in-hand" else "world"
            raise CalibError(f'camera {pair.camera} is not {eye}: the cell has it on = "{on}"')
    return tuple(found)


def _of(cell: Cell, instrument: Instrument, part: slice, eye: Eye | None) -> Iterator[Pair]:
    if isinstance(instrument, ArmCamera | FixedCamera):
        where: Eye = "in-hand" if isinstance(instrument, ArmCamera) else "on-base"
        for board in instrument.boards:
            own = slice(part.start + board.channels.start, part.start + board.channels.stop)
            yield Pair(instrument.name, board.name, where, instrument, own, board.points)
    elif isinstance(instrument, Pose):
        for k in range(part.start, part.stop):
            body = cell.channel_names[k]
            names = (body, instrument.name) if eye != "on-base" else (instrument.name, body)
            own = slice(k, k + 1)
            yield Pair(*names, eye or "in-hand", instrument, own, np.zeros((0, 3)))


def turn_between(R_a: Array, R_b: Array) -> Array:
    """Angles (...,), rad, between rotations (..., 3, 3)."""
    turn: Array = np.linalg.norm(so3_log(np.swapaxes(R_a, -1, -2) @ R_b), axis=-1)
    return turn
