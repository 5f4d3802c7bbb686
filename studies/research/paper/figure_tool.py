"""Counterparts of the paper's Figures 1 and 4: the measurement tool, drawn from the cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calib import Cell
from calib.arrays import Array
from studies.plots.style import (
    INK,
    PURPLE,
    SOFT,
    VERMILLION,
    Look,
    Picture,
    key_of,
    legend_below,
    sheet,
    styled,
    tidy,
)
from studies.plots.view import Viewpoint
from studies.research.paper.drawing import (
    BODY,
    LIGHT,
    arrow,
    ball,
    cylinder,
    frame,
    label,
    stage,
    symbol,
    tube,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BALL = 0.019  # m, radius of a reflector of 1.5 inches


@styled
def figure_1(cell: Cell) -> Picture:
    """Typical measurement tool: reference points on the flange, seen by the instrument.

    Counterpart of the paper's photograph, with the vectors p_tool of equation (6).
    """
    view = Viewpoint(-38.0, 20.0)
    figure = sheet(6.0, 4.4)
    panel = figure.subplots()
    stage(panel)
    _flange(panel, view)
    _bracket(panel, view, cell.markers)
    frame(panel, view, np.eye(4), 0.13, "flange frame", (-12, -26))
    for name, marker, shift in zip(
        cell.marker_names, cell.markers, ((-22, -12), (22, 9), (22, 9)), strict=True
    ):
        surface = marker * (1.0 - _BALL / np.linalg.norm(marker))
        arrow(panel, view, np.zeros(3), surface, lift=0.6, color=PURPLE, linestyle="--")
        ball(panel, view, marker, _BALL, VERMILLION)
        symbol(panel, view, marker, f"$p_{{tool}}^{{\\,{name[-1]}}}$", shift, fontsize=12)
    panel.autoscale_view()
    caption = (
        "Measurement tool of the cell: flange, and three reflectors at the positions of Table III, "
        "in the flange's frame. Drawn from the model where the paper has a photograph; the bracket "
        "is only indicated."
    )
    return Picture(
        "figure_1", "Typical measurement tool", caption, figure, *_marker_table(cell, load=False)
    )


@styled
def figure_4(cell: Cell) -> Picture:
    """The tool of the experiment with its dimensions: three markers and the point of the load."""
    load = load_point(cell)
    view = Viewpoint(-38.0, 20.0)
    figure = sheet(9.6, 4.0)
    space, side, front = figure.subplots(1, 3, width_ratios=[340, 370, 290])
    stage(space)
    _flange(space, view)
    _bracket(space, view, cell.markers)
    tube(space, view, np.array([[0.28, 0.0, 0.0], load]), (0.012, 0.012), facecolor=LIGHT)
    frame(space, view, np.eye(4), 0.11)
    for name, marker, shift in zip(
        cell.marker_names, cell.markers, ((-14, -9), (0, 14), (14, -9)), strict=True
    ):
        ball(space, view, marker, _BALL, VERMILLION)
        label(space, view, marker, name, shift)
    _hook(space, view, load)
    label(space, view, load, "load", (12, 8))
    space.autoscale_view()
    _plan_view(side, cell, load, (0, 2))
    _plan_view(front, cell, load, (1, 2))
    side.set_title("from the side")
    front.set_title("from the front")
    marks = [
        Look("marker", VERMILLION, "o", "", "", ""),
        Look("load point", INK, "v", "", "", ""),
        Look("origin of the flange's frame", SOFT, "+", "", "", ""),
    ]
    legend_below(figure, [key_of(mark) for mark in marks])
    caption = (
        "Tool of the elastostatic experiment with three markers (Table III) and the point where the "
        "load hangs, dimensions in mm in the flange's frame. Drawn from the model where the paper has "
        "a photograph; the bracket is only indicated. The load point is the demonstration's, the paper "
        "does not give it."
    )
    header, rows = _marker_table(cell, load=True)
    return Picture("figure_4", "Measurement tool with three markers", caption, figure, header, rows)


def load_point(cell: Cell) -> Array:
    """Where the load hangs, shape (3,), m, flange's frame."""
    if cell.load is None:
        raise ValueError("the cell has no load")
    return np.array(cell.load.com)


def _flange(panel: Axes, view: Viewpoint) -> None:
    """Last link up to the flange's face, which is the plane x = 0 of the tip frame."""
    x = np.array([1.0, 0.0, 0.0])
    cylinder(panel, view, -0.055 * x, x, 0.065, 0.05, facecolor=BODY)
    cylinder(panel, view, -0.015 * x, x, 0.10, 0.03, facecolor=BODY)


def _bracket(panel: Axes, view: Viewpoint, markers: Array) -> None:
    """A bar along x and an arm to each marker."""
    hub = np.array([markers[:, 0].mean(), 0.0, 0.0])
    tube(panel, view, np.array([np.zeros(3), hub]), (0.014, 0.014), facecolor=LIGHT)
    for marker in markers:
        tube(panel, view, np.array([hub, marker]), (0.009, 0.009), facecolor=LIGHT)


def _hook(panel: Axes, view: Viewpoint, load: Array) -> None:
    x, y = view.flat(load)
    panel.plot([x], [y], marker="v", markersize=9.0, color=INK, zorder=50.0)


def _plan_view(panel: Axes, cell: Cell, load: Array, axes: tuple[int, int]) -> None:
    """Markers and load point in two coordinates of the flange's frame, each with its numbers."""
    tidy(panel)
    panel.set_aspect("equal")
    points = np.vstack([cell.markers, load])[:, list(axes)] * 1e3
    panel.plot(0.0, 0.0, marker="+", markersize=11.0, color=SOFT, markeredgewidth=1.5)
    panel.plot(*points[:-1].T, linestyle="", marker="o", markersize=7.0, color=VERMILLION)
    panel.plot(*points[-1:].T, linestyle="", marker="v", markersize=8.0, color=INK)
    middle = float(np.mean([points[:, 0].min(), points[:, 0].max()]))
    for name, (a, b) in zip((*cell.marker_names, "load"), points, strict=True):
        right = axes == (1, 2) and a < middle + 60.0
        panel.annotate(
            f"{name}\n({_mm(a)}, {_mm(b)})", (a, b), (9.0 if right else -9.0, 0.0),
            textcoords="offset points", ha="left" if right else "right", va="center", fontsize=9,
        )  # fmt: skip
    first, second = ("xyz"[axis] for axis in axes)
    panel.set(xlabel=f"{first} [mm]", ylabel=f"{second} [mm]")
    panel.set_ylim(-140.0, 200.0)
    panel.set_xlim((-30.0, 340.0) if axes == (0, 2) else (-90.0, 200.0))


def _mm(value: float) -> str:
    return f"{value:.1f}".replace("-", "\N{MINUS SIGN}")


def _marker_table(cell: Cell, load: bool) -> tuple[tuple[str, ...], tuple[Any, ...]]:
    points = [*zip(cell.marker_names, cell.markers * 1e3, strict=True)]
    if load:
        points.append(("load point", load_point(cell) * 1e3))
    header = ("point in the flange's frame", "x [mm]", "y [mm]", "z [mm]")
    return header, tuple((name, *map(float, point)) for name, point in points)
