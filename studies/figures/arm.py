"""The arm at all poses, seen from the side, from the front and from above, and what is around it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib import Cell
from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.cell.planned import Ball, Body, Box
from studies.figures import style

_SIDE, _FRONT, _ABOVE = np.eye(3)[[0, 2]], np.eye(3)[[1, 2]], np.eye(3)[[0, 1]]
_FAINT = 20  # poses; of more, each is fainter
_AXES = (":x", ":y")  # a metre off: names of the ends of a frame's axes
_NEAR = 1.6  # arm lengths; an instrument farther away is not in the picture
_TURN = np.linspace(0.0, 2.0 * np.pi, 49)
_MARKER, _TIP = (
    style.Look("markers", style.BLUE, "."),
    style.Look("tip, first pose", style.INK, "o"),
)
_INSTRUMENT = style.Look("instrument", style.GREEN, "D")
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_EDGES = [
    (i, j) for i in range(8) for j in range(i) if np.abs(_CORNERS[i] - _CORNERS[j]).sum() == 2
]


@style.styled
def arm(cell: Cell, q: Array) -> Figure:
    """The nominal arm of a cell at joint values, shape (m, n), rad or m, in its base frame."""
    origins, markers = placed(cell, q)
    solids = [line for body in cell.design.obstacles for line in _outline(body)]
    points = np.concatenate([origins.reshape(-1, 3), markers.reshape(-1, 3), *solids])
    length = float(np.linalg.norm(origins, axis=-1).max())
    near = np.zeros((0, 3))
    if cell.instrument is not None and np.linalg.norm(cell.instrument) < _NEAR * length:
        near = cell.instrument[None]
    points = np.concatenate([points, near])
    low, high = points.min(axis=0) - 0.06 * length, points.max(axis=0) + 0.06 * length
    x, y, z = high - low
    height = style.PANEL * (z + y) / (x + y) + 0.5
    figure, every = style.panels(
        style.PANEL, min(max(height, 3.0), 9.0), 2, 2,
        gridspec_kw={"width_ratios": [x, y], "height_ratios": [z, y]}
    )  # fmt: skip
    style.fixed(figure, (0.5, 0.3, 0.05, 0.25), (0.5, 0.5))
    names = ("side: x, z [m]", "front: y, z [m]", "above: x, y [m]")
    for panel, view, name in zip(every, (_SIDE, _FRONT, _ABOVE), names, strict=False):
        draw_arm(panel, cell.robot, origins, markers, view)
        for line in solids:
            panel.plot(*view @ line.T, color=style.PURPLE, linewidth=1.0)
        _mark(panel, view, near, _INSTRUMENT, 6.0)
        (left, bottom), (right, top) = view @ low, view @ high
        panel.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        panel.set_title(name, loc="left", fontsize=9)
        panel.tick_params(labelsize=9)
        panel.locator_params(nbins=5)
    every[3].set_axis_off()
    every[3].legend(*every[0].get_legend_handles_labels(), loc="center left")
    return figure


def placed(cell: Cell, q: Array) -> tuple[Array, Array]:
    """Origins of the frames (m, F, 3) and markers (m, k, 3) of the nominal arm, m, base frame.

    q : ndarray, shape (m, n), rad or m. Ends of the axes of what is read as a frame are no markers
    """
    points = [not name.endswith(_AXES) for name in cell.marker_names]
    frames, on = forward(cell.robot, q), cell.marker_frames[points]
    origins = link_origins(cell.robot, frames, q)
    turned = np.einsum("mkij,kj->mki", frames.R_link[:, on], cell.markers[points])
    return origins, origins[:, on] + turned


def draw_arm(panel: Axes, robot: Robot, origins: Array, markers: Array, view: Array) -> None:
    """All poses faintly, the first one strongly; view : (2, 3), right and up of the picture."""
    count = len(origins)
    opacity = min(1.0, (_FAINT / count) ** 0.5)
    gap = np.full((count, 1, 3), np.nan)
    tips = [robot.tip_frame, *range(robot.dof + 1, robot.dof + 1 + len(robot.others))]
    for k, frame in enumerate(tips):
        way = origins[:, robot.carries[:, frame]]
        every = np.concatenate([way, gap], axis=1).reshape(-1, 3)
        panel.plot(
            *view @ every.T,
            color=style.DIM,
            linewidth=0.8,
            alpha=opacity,
            label="" if k else f"all {count} poses",
        )
        panel.plot(
            *view @ way[0].T, color=style.SOFT, linewidth=4.0, label="" if k else "first pose"
        )
        _mark(panel, view, way[0], style.Look("", style.INK, "o"), 2.5)
        _mark(panel, view, way[0, -1:], style.Look("", style.INK, "o") if k else _TIP, 4.5)
    _mark(panel, view, markers.reshape(-1, 3), _MARKER, 2.5)
    panel.axhline(0.0, color=style.SOFT, linewidth=0.6)


def _mark(panel: Axes, view: Array, points: Array, look: style.Look, size: float) -> None:
    """Points (k, 3); none leaves no name in the legend."""
    if len(points):
        x, y = view @ points.T
        style.dots(panel, x, y, look, markersize=size)


def _outline(body: Body) -> Iterator[Array]:
    """Lines (k, 3), m, of an obstacle that has an end."""
    if isinstance(body, Box):
        corners = (_CORNERS * body.half) @ body.T_base_box[:3, :3].T + body.T_base_box[:3, 3]
        yield from (corners[list(edge)] for edge in _EDGES)
    elif isinstance(body, Ball):
        circle = body.radius * np.stack([np.cos(_TURN), np.sin(_TURN), 0.0 * _TURN], axis=1)
        yield from (body.centre + np.roll(circle, k, axis=1) for k in range(3))
