"""Where a camera sees a board: configurations that are solved for, as few that are drawn do.

Where the board stands before the camera is drawn evenly among the places at which it faces it: tilt,
turn, distance and place in the image. The tip follows from it, and the joints from the tip: its place
in the world, or before the link that carries the other of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from calib.arm.approach import approached, turns
from calib.arm.kinematics import Frames, point_slopes
from calib.arm.robot import Robot
from calib.arm.se3 import displacement, fit_rigid, inverse, rotate, so3_exp, so3_log, transform
from calib.arrays import Array, IntArray, Mask
from calib.cell.cell import Cell
from calib.instruments import Camera
from calib.instruments.board import Board
from calib.instruments.camera import ArmCamera
from calib.instruments.lens import CENTER, FOCAL
from calib.instruments.riding import frame_of

NUMBERS = 6
"""Even numbers that place a board before a camera."""
_TURN = 0.6  # of the reach: what a radian weighs
_RELUCTANT = 1e-2  # damping: goals are many that no arm reaches
_NEAREST, _FARTHEST = 0.02, 2.0  # times the reach
_BESIDE = 0.8  # of half the image, in which the middle of a board lies of which a part is enough


@dataclass(frozen=True, eq=False)
class View:
    """A camera and a board that it sees.

    world, tip : ndarray, shape (4, 4), the frame of the one that stands in the world, base axes, and of
        the one on a tip, tip axes
    frame : int, of that tip; under : int or None, frame of the link that carries the other one, whose
        axes then are those meant by the base's
    """

    camera: Camera
    board: Board
    world: Array
    tip: Array
    frame: int
    under: int | None

    def tips(self, placed: Array) -> Array:
        """Tip frames (m, 4, 4) in base axes for the board's frames (m, 4, 4) in camera axes."""
        away = inverse(placed) if isinstance(self.camera, ArmCamera) else placed
        return np.asarray(self.world @ away @ inverse(self.tip))

    def placed(self, even: Array, reach: float) -> Array:
        """The board's frames (m, 4, 4) in camera axes; even : (m, 6), in [0, 1).

        reach : m, of the arm
        """
        lens = self.camera.lens.values
        centre = self.board.points.mean(axis=0)
        radius = float(np.linalg.norm(self.board.points - centre, axis=1).max())
        focal = float(lens[FOCAL].min())
        image = 2.0 * lens[CENTER] if self.camera.image is None else self.camera.image
        half = 0.5 * image
        whole = self.board.least == len(self.board.points)

        cosine = 1.0 - even[:, 0] * (1.0 - np.cos(self.camera.tilt))
        tilt, way, turn = np.arccos(cosine), 2.0 * np.pi * even[:, 1], 2.0 * np.pi * even[:, 2]
        leaning = tilt[:, None] * np.stack([np.cos(way), np.sin(way), 0.0 * way], axis=1)
        R = so3_exp(leaning) @ so3_exp(turn[:, None] * np.array([0.0, 0.0, 1.0]))

        fills = focal * radius / float(half.min())
        nearest = max(fills if whole else 0.5 * fills, _NEAREST * reach)
        depth = nearest * (max(_FARTHEST * reach, nearest) / nearest) ** even[:, 3]

        taken = focal * radius / depth[:, None] if whole else (1.0 - _BESIDE) * half
        room = np.maximum(half - taken, 0.0)
        pixels = 0.5 * image + room * (2.0 * even[:, 4:] - 1.0)
        ray = np.concatenate([self.camera.lens.ideal(pixels), np.ones((len(even), 1))], axis=1)
        return transform(R, depth[:, None] * ray - rotate(R, centre))


def views_of(cell: Cell) -> tuple[View, ...]:
    """Every camera with every board that it sees, where the cell says where both stand."""
    found = []
    for camera in cell.instruments:
        if not isinstance(camera, Camera) or camera.standing is None:
            continue
        read = camera.read_of(len(cell.markers))
        for board, standing in zip(camera.boards, _standing(camera), strict=True):
            T = displacement(standing)
            first = read[0 if isinstance(camera, ArmCamera) else board.channels.start]
            frame = int(cell.marker_frames[first])
            if isinstance(camera, ArmCamera):
                centre, axes = frame_of(cell.markers[read[: camera.each]])
                found.append(View(camera, board, T, transform(axes.T, centre), frame, None))
            else:
                on_tip = fit_rigid(cell.markers[read[board.channels]], board.points)
                under = None if camera.seat is None else int(cell.marker_frames[camera.seat][0])
                found.append(View(camera, board, inverse(T), on_tip, frame, under))
    return tuple(found)


def _standing(camera: Camera) -> Array:
    """What the cell says of each board: its place, or that of the camera, shape (boards, 6)."""
    places = np.zeros(6) if camera.standing is None else camera.standing
    return np.broadcast_to(places.reshape(-1, 6), (len(camera.boards), 6))


def looking(cell: Cell, q: Array, wanted: IntArray, even: Array, free: Mask) -> Array:
    """Configurations (m, dof) brought to the views wanted of each, (m,), as far as the arm comes.

    wanted : positions among the views, -1 for none; even : ndarray, shape (m, 6), in [0, 1)
    free : ndarray of bool, shape (dof,), joints that may move
    """
    q = q.copy()
    for k, view in enumerate(views_of(cell)):
        own = np.flatnonzero(wanted == k)
        if len(own):
            goal = view.tips(view.placed(even[own], cell.robot.reach))
            missed = partial(_missed, cell.robot, view, goal)
            q[own] = approached(cell.robot, q[own], free, missed, _RELUCTANT)
    return q


def _missed(
    robot: Robot, view: View, goal: Array, starts: IntArray, frames: Frames
) -> tuple[Array, Array]:
    """Place, and what a turn weighs, of the tip beyond its goal (n, 4, 4)."""
    wanted, length = goal[starts], _TURN * robot.reach
    R, o = frames.R[:, view.frame], frames.o[:, view.frame]
    slopes, turning = point_slopes(robot, frames, o, view.frame), turns(robot, frames, view.frame)
    if view.under is not None:
        back = np.swapaxes(frames.R[:, view.under], -1, -2)
        slopes = back @ (slopes - point_slopes(robot, frames, o, view.under))
        turning = back @ (turning - turns(robot, frames, view.under))
        R, o = back @ R, rotate(back, o - frames.o[:, view.under])
    turn = so3_log(R @ np.swapaxes(wanted[:, :3, :3], -1, -2))
    J = np.concatenate([slopes, length * turning], axis=1)
    return np.concatenate([o - wanted[:, :3, 3], length * turn], axis=1), J
