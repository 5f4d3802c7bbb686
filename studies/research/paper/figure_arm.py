"""Counterpart of the paper's Figure 2: the arm of equation (21) and the two kinds of input data."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import fit_rigid, rotate, so3_log, transform
from calib.arrays import Array
from studies.plots.style import BLUE, FAINT, SOFT, VERMILLION, Picture, sheet, styled
from studies.plots.view import Viewpoint
from studies.research.paper.arm import arm_of_equation_21
from studies.research.paper.drawing import (
    LIGHT,
    arc,
    ball,
    cylinder,
    frame,
    ground,
    line,
    plate,
    stage,
    symbol,
    tube,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# For drawing only: the paper gives neither its poses nor its triangle of section IV.
ARM_POSE = np.radians([0.0, 55.0, -75.0])
TRIANGLE = np.array([[0.0, 0.09, -0.06], [0.0, -0.09, -0.06], [0.0, 0.0, 0.11]])


@styled
def figure_2(q: Array = ARM_POSE, markers: Array = TRIANGLE) -> Picture:
    """Kinematics of the arm of equation (21), and what the two approaches take from the markers.

    q : ndarray, shape (3,), rad; markers : ndarray, shape (3, 3), m, tip frame
    """
    robot = arm_of_equation_21()
    frames = forward(robot, q[None, :])
    origins, tip = frames.o[0], transform(frames.R[0, -1], frames.o[0, -1])
    points = rotate(tip[:3, :3], markers) + tip[:3, 3]
    figure = sheet(8.8, 5.2)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.1, 1.0])
    arm = figure.add_subplot(grid[:, 0])
    _draw_arm(arm, Viewpoint(-62.0, 16.0), q, origins, points)
    for row, approach in enumerate((_draw_pose, _draw_points)):
        panel = figure.add_subplot(grid[row, 1])
        stage(panel)
        approach(panel, Viewpoint(-28.0, 14.0), tip, points)
        panel.margins(0.12)
        panel.autoscale_view()
    computed = fit_rigid(points, markers)
    rows: list[tuple[Any, ...]] = [
        (f"p{j + 1}", "input of #2, measured", *map(float, point * 1e3), "mm")
        for j, point in enumerate(points)
    ]
    rows.append(("p0", "input of #1, computed", *map(float, computed[:3, 3] * 1e3), "mm"))
    turned = np.degrees(so3_log(computed[:3, :3]))
    rows.append(("phi0", "input of #1, computed", *map(float, turned), "deg"))
    degrees = ", ".join(f"{angle:.0f}" for angle in np.degrees(q))
    caption = (
        f"Arm of equation (21) at q = ({degrees}) deg, link lengths 1, 0.8 and 0.6 m. Approach #1 "
        "computes position p0 and orientation phi0 from the three markers and keeps six numbers of a "
        "pose; approach #2 takes the nine coordinates as they are. Pose and marker triangle are chosen "
        "for the drawing."
    )
    header = ("quantity", "use", "x", "y", "z", "unit")
    return Picture(
        "figure_2",
        "Input data of the two identification approaches",
        caption,
        figure,
        header,
        tuple(rows),
    )


def _draw_arm(panel: Axes, view: Viewpoint, q: Array, origins: Array, points: Array) -> None:
    """Links, joints, lengths and angles."""
    stage(panel)
    base, shoulder, elbow, tip = origins[0], origins[2], origins[3], origins[4]
    ground(panel, view, np.zeros((1, 3)), 0.42)
    up = np.array([0.0, 0.0, 1.0])
    chain = np.array([base + 0.06 * up, shoulder, elbow, tip])
    for a, b in pairwise(chain):
        tube(panel, view, np.array([a, b]), (0.045, 0.045))
    radial = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
    across = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
    cylinder(panel, view, base + 0.05 * up, up, 0.11, 0.10, lift=-0.2)
    for joint in (shoulder, elbow):
        cylinder(panel, view, joint, across, 0.075, 0.16, lift=0.4)
    frame(panel, view, np.eye(4), 0.33)
    for marker in points:
        line(panel, view, np.array([tip, marker]), lift=0.4, color=SOFT)
        ball(panel, view, marker, 0.028, VERMILLION, lift=0.6)
    for a, b, text, shift in (
        (base, shoulder, "$l_1$", (-14, 0)),
        (shoulder, elbow, "$l_2$", (-13, 6)),
        (elbow, tip, "$l_3$", (-8, -14)),
    ):
        symbol(panel, view, 0.5 * (a + b), text, shift, fontsize=12)
    dashed: dict[str, Any] = {"color": SOFT, "linestyle": (0, (4, 3)), "lift": 0.5}
    line(panel, view, np.array([shoulder, shoulder + 0.42 * radial]), **dashed)
    reach = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    line(panel, view, np.array([elbow, elbow + 0.36 * reach]), **dashed)
    turn = {"color": BLUE, "linewidth": 1.4}
    axis = -across
    front = np.array([np.cos(-2.2), np.sin(-2.2), 0.0])
    middle = arc(panel, view, base + 0.62 * up, 0.16 * front, up, 2.4, **turn)
    symbol(panel, view, middle, "$q_1$", (16, -9), fontsize=12, color=BLUE)
    middle = arc(panel, view, shoulder, 0.30 * radial, axis, q[1], **turn)
    symbol(panel, view, middle, "$q_2$", (9, 5), fontsize=12, color=BLUE)
    middle = arc(panel, view, elbow, 0.27 * reach, axis, q[2], **turn)
    symbol(panel, view, middle, "$q_3$", (11, 8), fontsize=12, color=BLUE)
    panel.autoscale_view()


def _draw_pose(panel: Axes, view: Viewpoint, tip: Array, points: Array) -> None:
    """Approach #1: the triangle is replaced by a position and an orientation."""
    plate(panel, view, points, facecolor=LIGHT, edgecolor=SOFT, linestyle="--")
    for j, point in enumerate(points):
        line(panel, view, np.array([tip[:3, 3], point]), lift=0.2, color=SOFT, linestyle=":")
        ball(panel, view, point, 0.010, FAINT)
        symbol(
            panel, view, point, f"$p_{j + 1}$", _outward(view, tip, point), fontsize=11, color=SOFT
        )
    frame(panel, view, tip, 0.075)
    symbol(panel, view, tip[:3, 3], r"$p_0,\ \varphi_0$", (-38, 8), fontsize=12)
    panel.set_title(r"#1: pose $(p_0, \varphi_0)$ computed, 6 numbers a pose", parse_math=True)


def _draw_points(panel: Axes, view: Viewpoint, tip: Array, points: Array) -> None:
    """Approach #2: the measured points themselves."""
    plate(panel, view, points, facecolor=LIGHT, edgecolor=SOFT, linewidth=0.6)
    for j, point in enumerate(points):
        ball(panel, view, point, 0.010, VERMILLION)
        symbol(panel, view, point, f"$p_{j + 1}$", _outward(view, tip, point), fontsize=12)
    panel.set_title("#2: points $(p_1, p_2, p_3)$ as measured, 9 numbers a pose", parse_math=True)


def _outward(view: Viewpoint, tip: Array, point: Array) -> tuple[float, float]:
    away = view.flat(point - tip[:3, 3])
    away = 13.0 * away / max(float(np.linalg.norm(away)), 1e-9)
    return float(away[0]), float(away[1])
