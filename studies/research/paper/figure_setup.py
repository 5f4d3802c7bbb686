"""Counterpart of the paper's Figure 3: the experiment on the KR 270, free and loaded."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calib import Cell, Poses
from calib.arm.se3 import inverse, rotate, transform
from calib.arrays import Array
from calib.model import Model
from calib.model.build import build
from calib.poses import hung
from studies.demo.embedded import true_values
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
)
from studies.plots.view import Viewpoint
from studies.research.paper.drawing import (
    BODY,
    LIGHT,
    ball,
    cylinder,
    frame,
    ground,
    label,
    line,
    stage,
    tube,
)
from studies.research.paper.figure_tool import load_point

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ELASTIC = ("stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
_JOINT_LABELS = (("A1", (22, 0)), ("A2", (-14, -14)), ("A3", (0, 20)), ("A4 A5 A6", (0, 18)))
_SHOWN_DEFLECTION = 0.5  # m, how long the largest deflection is drawn


@styled
def figure_3(cell: Cell, plan: Poses, pose: str = "p06") -> Picture:
    """The experiment: robot, hung load, tracker and beams; the arm free and loaded.

    pose : str, a configuration of Table II by its name
    """
    index = plan.names.index(pose)
    model, values, loaded = _elastic_model(cell, plan.take([index]))
    free = replace(loaded, load_mass=np.zeros(1))
    before, after = (_chain(model, values, poses) for poses in (free, loaded))
    moved = after - before
    largest = float(np.linalg.norm(moved, axis=1).max())
    factor = _round_factor(_SHOWN_DEFLECTION / largest)
    drawn = before + factor * moved
    view = Viewpoint(-16.0, 16.0)
    figure = sheet(8.6, 4.9)
    panel = figure.subplots()
    stage(panel)
    instrument = _instrument(cell, plan)
    _draw_robot(panel, view, before, len(cell.markers), solid=True)
    _draw_robot(panel, view, drawn, len(cell.markers), solid=False)
    _draw_load(panel, view, before[-1], cell)
    _draw_tracker(panel, view, instrument, before[-1 - len(cell.markers) : -1])
    ground(panel, view, np.vstack([before, instrument]), 0.35)
    frame(panel, view, np.eye(4), 0.55)
    panel.autoscale_view()
    keys = [
        Look("arm without the load", INK, "o", "-", "", ""),
        Look(f"with the load, deflection drawn {factor:g} times", VERMILLION, "s", "--", "", ""),
        Look("laser beam", PURPLE, "", ":", "", ""),
    ]
    body = {"color": BODY, "linewidth": 7.0, "markerfacecolor": LIGHT, "markeredgecolor": INK}
    first, *others = keys
    legend_below(figure, [key_of(first, **body), *(key_of(key, markersize=5.0) for key in others)])
    caption = (
        f"Set-up of the elastostatic experiment at configuration {pose} of Table II: joints of the "
        f"KUKA KR 270 from its URDF, {_mass(cell):g} kg hanging at the tool, a laser tracker reading "
        f"three markers. The load moves the tool by up to {largest * 1e3:.1f} mm under the compliances "
        f"of Table IV; the drawing shows that {factor:g} times. Drawn from the model where the paper "
        "has a photograph; where the tracker stands is the demonstration's choice."
    )
    names = ["base", *cell.robot.joints, "flange", *cell.marker_names, "load point"]
    header = (
        "point", "x free [mm]", "y free [mm]", "z free [mm]", "dx [mm]", "dy [mm]", "dz [mm]",
    )  # fmt: skip
    rows: tuple[tuple[Any, ...], ...] = tuple(
        (name, *map(float, at * 1e3), *map(float, d * 1e3))
        for name, at, d in zip(names, before, moved, strict=True)
    )
    return Picture("figure_3", "Experimental setup", caption, figure, header, rows)


def _mass(cell: Cell) -> float:
    return cell.load.mass if cell.load is not None else 0.0


def _round_factor(factor: float) -> float:
    """The nearest of 1, 2, 5, 10, 20, .. below."""
    decade = 10.0 ** np.floor(np.log10(factor))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= factor))


def _elastic_model(cell: Cell, poses: Poses) -> tuple[Model, Array, Poses]:
    """The arm with the compliances of Table IV, and the poses with the load on."""
    loaded = hung(poses, _mass(cell), load_point(cell).tolist())
    model = build(replace(cell, effects=ELASTIC), loaded).model
    return model, true_values(model, np.random.default_rng(0)), loaded


def _chain(model: Model, values: Array, poses: Poses) -> Array:
    """Base, joints, flange, markers and load point at one pose, shape (k, 3), m, base frame."""
    frames = model.state(values, poses).frames
    carried = np.vstack([model.markers, poses.load_com])
    tool = rotate(frames.R[0, -1], carried) + frames.o[0, -1]
    return np.vstack([frames.o[0], tool])


def _instrument(cell: Cell, plan: Poses) -> Array:
    """Where the demonstration's tracker stands, shape (3,), m, base frame."""
    model = build(replace(cell, effects=("base",)), plan).model
    R, p = model.placement(true_values(model, np.random.default_rng(0)), plan)
    return np.asarray(inverse(transform(R[0], p[0]))[:3, 3])


def _draw_robot(panel: Axes, view: Viewpoint, points: Array, markers: int, solid: bool) -> None:
    """Links between the joints' origins; the loaded arm as a dashed line."""
    joints, tool = points[: -1 - markers], points[-1 - markers :]
    if not solid:
        style: dict[str, Any] = {
            "color": VERMILLION,
            "linestyle": "--",
            "linewidth": 1.6,
            "lift": 3.0,
        }
        line(panel, view, joints[2:], marker="s", markersize=4.0, **style)  # A1 and A2 stay
        for point in tool:
            line(panel, view, np.array([joints[-1], point]), **(style | {"linewidth": 0.9}))
        return
    radii = np.linspace(0.17, 0.07, len(joints))
    up = np.array([0.0, 0.0, 1.0])
    cylinder(panel, view, 0.25 * up, up, 0.24, 0.5, lift=-0.3)
    tube(panel, view, np.array([0.5 * up, joints[1]]), (0.2, 0.16), lift=-0.2)
    for k in range(1, len(joints) - 1):
        if np.linalg.norm(joints[k + 1] - joints[k]) > 1e-6:
            tube(panel, view, joints[k : k + 2], (radii[k], radii[k + 1]))
    for k, joint in enumerate(joints[1:-1]):
        ball(panel, view, joint, 0.045, LIGHT, lift=1.0)
        if k < len(_JOINT_LABELS):  # A4, A5 and A6 meet in one point
            label(panel, view, joint, *_JOINT_LABELS[k])
    for point in tool[:-1]:
        line(panel, view, np.array([joints[-1], point]), lift=1.0, color=INK)
        ball(panel, view, point, 0.035, VERMILLION, lift=1.2)


def _draw_load(panel: Axes, view: Viewpoint, hook: Array, cell: Cell) -> None:
    """The mass below its hook: a drum on a rope."""
    down = cell.gravity / np.linalg.norm(cell.gravity)
    drop = min(0.55, max(0.2, 0.6 * float(hook[2])))
    centre = hook + (drop + 0.17) * down
    line(panel, view, np.array([hook, centre]), lift=0.8, linewidth=1.6)
    cylinder(panel, view, centre, down, 0.16, 0.30, facecolor="0.6", lift=0.9)
    label(panel, view, centre, f"{_mass(cell):g} kg", (17, 0))


def _draw_tracker(panel: Axes, view: Viewpoint, head: Array, markers: Array) -> None:
    """A stand, a head, and a beam to each marker."""
    up = np.array([0.0, 0.0, 1.0])
    neck = head - 0.15 * up
    for turn in np.radians([90.0, 210.0, 330.0]):
        foot = np.array([head[0] + 0.3 * np.cos(turn), head[1] + 0.3 * np.sin(turn), 0.0])
        line(panel, view, np.array([neck, foot]), linewidth=2.0, color=SOFT)
    cylinder(panel, view, neck + 0.05 * up, up, 0.11, 0.22, lift=0.5)
    ball(panel, view, head + 0.06 * up, 0.11, BODY)
    beam: dict[str, Any] = {"color": PURPLE, "linestyle": ":", "linewidth": 1.3}
    for marker in markers:
        line(panel, view, np.array([head, marker]), lift=3.0, **beam)
    label(panel, view, head, "laser tracker", (0, 22))
