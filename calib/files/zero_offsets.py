"""Zero offsets as a table: for a controller that takes no other geometry (KUKA, FANUC)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import fit_rigid, rotate
from calib.arrays import Array
from calib.errors import InputError
from calib.files.write_tables import csv_text

_POSES = 128


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """What of a corrected geometry lies along the joints' own axes.

    offsets : ndarray, shape (n,), rad or m, ``q_true = q_read + offset``
    before, after : float, m, 3-D RMS by which the markers of the nominal arm miss those of the
        corrected one, the base fitted, without and with the offsets
    """

    offsets: Array
    before: float
    after: float


def zero_offsets(robot: Robot, corrections: Array, markers: Array) -> ZeroOffsets:
    """The offsets of a geometry, and how much of it they are, over Sobol poses within the limits.

    corrections : ndarray, shape (n + 2, 6), m and rad, as in :class:`~calib.arm.robot.Robot`
    markers : ndarray, shape (M, 3), m, tip frame
    """
    from scipy.stats import qmc

    own = corrections[1:-1]
    along = np.where(robot.prismatic[:, None], own[:, :3], own[:, 3:])
    offsets = np.einsum("ki,ki->k", along, robot.axes)
    low, high = robot.sample_limits().T
    q = robot.tied(low + (high - low) * qmc.Sobol(robot.dof, rng=0).random(_POSES))
    true = _points(robot, q, markers, corrections)
    before, after = (_missed(true, _points(robot, p, markers)) for p in (q, q + offsets))
    return ZeroOffsets(offsets, before, after)


def zero_offsets_csv(
    robot: Robot, found: ZeroOffsets, counts_per_deg: dict[str, float] | None = None
) -> str:
    """The text of the table, a row a joint.

    ``reads_at_zero`` is what the controller shows where the joint truly is at zero. With encoder counts
    a degree (signed: rising with the joint's angle) ``master_count_change`` is to be added to FANUC's
    ``$MASTER_COUN``, as ``angle = (count - $MASTER_COUN) / counts a degree``.

    Raises InputError for counts of a joint that does not turn, or is not there.
    """
    counts = counts_per_deg or {}
    for name in counts:
        if name not in robot.joints or robot.prismatic[robot.joints.index(name)]:
            turning = [j for j, p in zip(robot.joints, robot.prismatic, strict=True) if not p]
            raise InputError(
                "--counts-per-deg", "", f"no joint {name!r} that turns", f"use {', '.join(turning)}"
            )
    header = ["joint", "offset", "reads_at_zero", "unit"]
    header += ["master_count_change"] if counts else []
    rows = []
    for k, joint in enumerate(robot.joints):
        shown = found.offsets[k] * 1e3 if robot.prismatic[k] else np.degrees(found.offsets[k])
        row = [
            joint,
            f"{shown + 0.0:.9g}",
            f"{-shown + 0.0:.9g}",
            "mm" if robot.prismatic[k] else "deg",
        ]
        if counts:
            row.append(f"{-shown * counts[joint]:.0f}" if joint in counts else "")
        rows.append(row)
    return csv_text(header, rows)


def _points(robot: Robot, q: Array, markers: Array, corrections: Array | None = None) -> Array:
    frames = forward(robot, q, corrections)
    return rotate(frames.R[:, None, -1], markers) + frames.o[:, None, -1]


def _missed(true: Array, points: Array) -> float:
    T = fit_rigid(true.reshape(-1, 3), points.reshape(-1, 3))
    missed = rotate(T[:3, :3], points) + T[:3, 3] - true
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=-1))))
