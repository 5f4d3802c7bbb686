"""Counterparts of the paper's Figures 1 to 4: ``python -m studies.research.paper.figures FOLDER``.

The paper's Figures 1, 3 and 4 are photographs. Here everything stands where the model has it: frames
and joints of the URDF, markers of Table III, a configuration of Table II, the deflection under 250 kg.
Bodies around these points (links, bracket, stand) are only indicated.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from calib import Cell, Poses
from calib.arm.kinematics import forward
from calib.arm.se3 import fit_rigid, inverse, rotate, so3_log, transform
from calib.arrays import Array
from calib.files.write import write_files
from calib.model import Model
from calib.model.build import build
from calib.poses import hung
from studies.demo.embedded import embedded_cell, embedded_plan, true_values
from studies.plots.style import (
    BLUE,
    FAINT,
    INK,
    PURPLE,
    SOFT,
    VERMILLION,
    Look,
    Picture,
    folder_files,
    key_of,
    legend_below,
    sheet,
    styled,
    tidy,
)
from studies.report.arm_drawing import Viewpoint
from studies.research.benchmarks.design import ELASTIC
from studies.research.paper.arm import arm_of_equation_21
from studies.research.paper.drawing import BODY, LIGHT, Drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AT_THE_TOOL = Viewpoint(-38.0, 20.0)
_BALL = 0.019  # m, radius of a reflector of 1.5 inches


@styled
def figure_1(cell: Cell) -> Picture:
    """Typical measurement tool: reference points on the flange, seen by the instrument.

    Counterpart of the paper's photograph, with the vectors p_tool of equation (6).
    """
    figure = sheet(6.0, 4.4)
    draw = Drawing(figure.subplots(), _AT_THE_TOOL)
    _tool(draw, cell.markers)
    draw.frame(np.eye(4), 0.13, "flange frame", (-12, -26))
    for name, marker, shift in zip(
        cell.marker_names, cell.markers, ((-22, -12), (22, 9), (22, 9)), strict=True
    ):
        surface = marker * (1.0 - _BALL / np.linalg.norm(marker))
        draw.arrow(np.zeros(3), surface, lift=0.6, color=PURPLE, linestyle="--")
        draw.ball(marker, _BALL, VERMILLION)
        draw.symbol(marker, f"$p_{{tool}}^{{\\,{name[-1]}}}$", shift, fontsize=12)
    draw.panel.autoscale_view()
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
    figure = sheet(9.6, 4.0)
    space, side, front = figure.subplots(1, 3, width_ratios=[340, 370, 290])
    draw = Drawing(space, _AT_THE_TOOL)
    _tool(draw, cell.markers)
    draw.tube(np.array([[0.28, 0.0, 0.0], load]), (0.012, 0.012), facecolor=LIGHT)
    draw.frame(np.eye(4), 0.11)
    for name, marker, shift in zip(
        cell.marker_names, cell.markers, ((-14, -9), (0, 14), (14, -9)), strict=True
    ):
        draw.ball(marker, _BALL, VERMILLION)
        draw.label(marker, name, shift)
    space.plot(*draw.view.flat(load)[:, None], marker="v", markersize=9.0, color=INK, zorder=50.0)
    draw.label(load, "load", (12, 8))
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


def _tool(draw: Drawing, markers: Array) -> None:
    """Last link up to the flange's face, the plane x = 0; a bar along x, an arm to each marker."""
    x = np.array([1.0, 0.0, 0.0])
    draw.cylinder(-0.055 * x, x, 0.065, 0.05, facecolor=BODY)
    draw.cylinder(-0.015 * x, x, 0.10, 0.03, facecolor=BODY)
    hub = np.array([markers[:, 0].mean(), 0.0, 0.0])
    draw.tube(np.array([np.zeros(3), hub]), (0.014, 0.014), facecolor=LIGHT)
    for marker in markers:
        draw.tube(np.array([hub, marker]), (0.009, 0.009), facecolor=LIGHT)


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
    arm = Drawing(figure.add_subplot(grid[:, 0]), Viewpoint(-62.0, 16.0))
    _draw_arm(arm, q, origins, points)
    for row, approach in enumerate((_draw_pose, _draw_points)):
        panel = figure.add_subplot(grid[row, 1])
        approach(Drawing(panel, Viewpoint(-28.0, 14.0)), tip, points)
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


def _draw_arm(draw: Drawing, q: Array, origins: Array, points: Array) -> None:
    """Links, joints, lengths and angles."""
    base, shoulder, elbow, tip = origins[0], origins[2], origins[3], origins[4]
    draw.ground(np.zeros((1, 3)), 0.42)
    up = np.array([0.0, 0.0, 1.0])
    chain = np.array([base + 0.06 * up, shoulder, elbow, tip])
    for a, b in pairwise(chain):
        draw.tube(np.array([a, b]), (0.045, 0.045))
    radial = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
    across = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
    draw.cylinder(base + 0.05 * up, up, 0.11, 0.10, lift=-0.2)
    for joint in (shoulder, elbow):
        draw.cylinder(joint, across, 0.075, 0.16, lift=0.4)
    draw.frame(np.eye(4), 0.33)
    for marker in points:
        draw.line(np.array([tip, marker]), lift=0.4, color=SOFT)
        draw.ball(marker, 0.028, VERMILLION, lift=0.6)
    for a, b, text, shift in (
        (base, shoulder, "$l_1$", (-14, 0)),
        (shoulder, elbow, "$l_2$", (-13, 6)),
        (elbow, tip, "$l_3$", (-8, -14)),
    ):
        draw.symbol(0.5 * (a + b), text, shift, fontsize=12)
    dashed: dict[str, Any] = {"color": SOFT, "linestyle": (0, (4, 3)), "lift": 0.5}
    draw.line(np.array([shoulder, shoulder + 0.42 * radial]), **dashed)
    reach = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    draw.line(np.array([elbow, elbow + 0.36 * reach]), **dashed)
    turn = {"color": BLUE, "linewidth": 1.4}
    axis = -across
    front = np.array([np.cos(-2.2), np.sin(-2.2), 0.0])
    middle = draw.arc(base + 0.62 * up, 0.16 * front, up, 2.4, **turn)
    draw.symbol(middle, "$q_1$", (16, -9), fontsize=12, color=BLUE)
    middle = draw.arc(shoulder, 0.30 * radial, axis, q[1], **turn)
    draw.symbol(middle, "$q_2$", (9, 5), fontsize=12, color=BLUE)
    middle = draw.arc(elbow, 0.27 * reach, axis, q[2], **turn)
    draw.symbol(middle, "$q_3$", (11, 8), fontsize=12, color=BLUE)
    draw.panel.autoscale_view()


def _draw_pose(draw: Drawing, tip: Array, points: Array) -> None:
    """Approach #1: the triangle is replaced by a position and an orientation."""
    draw.plate(points, facecolor=LIGHT, edgecolor=SOFT, linestyle="--")
    for j, point in enumerate(points):
        draw.line(np.array([tip[:3, 3], point]), lift=0.2, color=SOFT, linestyle=":")
        draw.ball(point, 0.010, FAINT)
        draw.symbol(point, f"$p_{j + 1}$", _outward(draw.view, tip, point), fontsize=11, color=SOFT)
    draw.frame(tip, 0.075)
    draw.symbol(tip[:3, 3], r"$p_0,\ \varphi_0$", (-38, 8), fontsize=12)
    draw.panel.set_title(r"#1: pose $(p_0, \varphi_0)$ computed, 6 numbers a pose", parse_math=True)


def _draw_points(draw: Drawing, tip: Array, points: Array) -> None:
    """Approach #2: the measured points themselves."""
    draw.plate(points, facecolor=LIGHT, edgecolor=SOFT, linewidth=0.6)
    for j, point in enumerate(points):
        draw.ball(point, 0.010, VERMILLION)
        draw.symbol(point, f"$p_{j + 1}$", _outward(draw.view, tip, point), fontsize=12)
    draw.panel.set_title(
        "#2: points $(p_1, p_2, p_3)$ as measured, 9 numbers a pose", parse_math=True
    )


def _outward(view: Viewpoint, tip: Array, point: Array) -> tuple[float, float]:
    away = view.flat(point - tip[:3, 3])
    away = 13.0 * away / max(float(np.linalg.norm(away)), 1e-9)
    return float(away[0]), float(away[1])


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
    figure = sheet(8.6, 4.9)
    draw = Drawing(figure.subplots(), Viewpoint(-16.0, 16.0))
    instrument = _instrument(cell, plan)
    _draw_robot(draw, before, len(cell.markers), solid=True)
    _draw_robot(draw, drawn, len(cell.markers), solid=False)
    _draw_load(draw, before[-1], cell)
    _draw_tracker(draw, instrument, before[-1 - len(cell.markers) : -1])
    draw.ground(np.vstack([before, instrument]), 0.35)
    draw.frame(np.eye(4), 0.55)
    draw.panel.autoscale_view()
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


def _draw_robot(draw: Drawing, points: Array, markers: int, solid: bool) -> None:
    """Links between the joints' origins; the loaded arm as a dashed line."""
    joints, tool = points[: -1 - markers], points[-1 - markers :]
    if not solid:
        style: dict[str, Any] = {
            "color": VERMILLION,
            "linestyle": "--",
            "linewidth": 1.6,
            "lift": 3.0,
        }
        draw.line(joints[2:], marker="s", markersize=4.0, **style)  # A1 and A2 stay
        for point in tool:
            draw.line(np.array([joints[-1], point]), **(style | {"linewidth": 0.9}))
        return
    radii = np.linspace(0.17, 0.07, len(joints))
    up = np.array([0.0, 0.0, 1.0])
    draw.cylinder(0.25 * up, up, 0.24, 0.5, lift=-0.3)
    draw.tube(np.array([0.5 * up, joints[1]]), (0.2, 0.16), lift=-0.2)
    for k in range(1, len(joints) - 1):
        if np.linalg.norm(joints[k + 1] - joints[k]) > 1e-6:
            draw.tube(joints[k : k + 2], (radii[k], radii[k + 1]))
    for k, joint in enumerate(joints[1:-1]):
        draw.ball(joint, 0.045, LIGHT, lift=1.0)
        if k < len(_JOINT_LABELS):  # A4, A5 and A6 meet in one point
            draw.label(joint, *_JOINT_LABELS[k])
    for point in tool[:-1]:
        draw.line(np.array([joints[-1], point]), lift=1.0, color=INK)
        draw.ball(point, 0.035, VERMILLION, lift=1.2)


def _draw_load(draw: Drawing, hook: Array, cell: Cell) -> None:
    """The mass below its hook: a drum on a rope."""
    down = cell.gravity / np.linalg.norm(cell.gravity)
    drop = min(0.55, max(0.2, 0.6 * float(hook[2])))
    centre = hook + (drop + 0.17) * down
    draw.line(np.array([hook, centre]), lift=0.8, linewidth=1.6)
    draw.cylinder(centre, down, 0.16, 0.30, facecolor="0.6", lift=0.9)
    draw.label(centre, f"{_mass(cell):g} kg", (17, 0))


def _draw_tracker(draw: Drawing, head: Array, markers: Array) -> None:
    """A stand, a head, and a beam to each marker."""
    up = np.array([0.0, 0.0, 1.0])
    neck = head - 0.15 * up
    for turn in np.radians([90.0, 210.0, 330.0]):
        foot = np.array([head[0] + 0.3 * np.cos(turn), head[1] + 0.3 * np.sin(turn), 0.0])
        draw.line(np.array([neck, foot]), linewidth=2.0, color=SOFT)
    draw.cylinder(neck + 0.05 * up, up, 0.11, 0.22, lift=0.5)
    draw.ball(head + 0.06 * up, 0.11, BODY)
    beam: dict[str, Any] = {"color": PURPLE, "linestyle": ":", "linewidth": 1.3}
    for marker in markers:
        draw.line(np.array([head, marker]), lift=3.0, **beam)
    draw.label(head, "laser tracker", (0, 22))


def pictures() -> list[Picture]:
    """All four, from the embedded cell."""
    cell = embedded_cell()
    plan = embedded_plan(cell)
    return [figure_1(cell), figure_2(), figure_3(cell, plan), figure_4(cell)]


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Draw the counterparts of the paper's Figures 1 to 4 into FOLDER: SVG, PNG and CSV."""
    folder.mkdir(parents=True, exist_ok=True)
    made = folder_files(pictures(), folder)
    write_files(made)
    for path in made:
        click.echo(f"wrote {path}")


if __name__ == "__main__":
    main()
