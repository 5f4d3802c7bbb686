"""What people get wrong when they write down joints and points, one entry each.

Every entry undoes its mistake. None of them is an error that an arm has: an arm errs by a small part
of its size, and these move every point by a large one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray, Mask
from calib.effects.base import Base
from calib.effects.protocol import Effect
from calib.effects.tool import Tool
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

Undo: TypeAlias = Callable[[Measurements], Measurements]

_DEGREE = np.pi / 180.0
_PARALLEL = 0.99  # cosine between axes
# A turn, in deg, that mends a zero, and by how much that is off; half a turn has no sign.
_QUARTERS = {-90.0: "90", 90.0: "-90", 180.0: "180"}
_METRES = {"metres": 1.0, "millimetres": 1e-3, "inches": 0.0254}
_PAIRS = ("metres", "millimetres"), ("inches", "millimetres"), ("inches", "metres")
# What columns hold, and what they are named by.
_COLUMNS = [both for pair in _PAIRS for both in (pair, pair[::-1])]


@dataclass(frozen=True, eq=False)
class DataMistake:
    """One mistake.

    name : str; said : str, what is wrong; remedy : str, what to do
    undone : the measurements as they would read without it
    freed : the model that does not presume what is wrong
    """

    name: str
    said: str
    remedy: str
    undone: Undo
    freed: Callable[[Model, Measurements], Model] = lambda model, _: model


def tables(model: Model) -> tuple[tuple[DataMistake, ...], ...]:
    """All that could be wrong with every reading of this arm and these markers, likelier ones first.

    Of the entries of one table several may explain the same readings.
    """
    robot = model.robot
    columns = (_mirrored(model), _units(robot), _joints(robot), _zeros(robot, 1), _renamed(model))
    return (tuple(itertools.chain(*columns)), *((slip,) for slip in _taken_as_known(model)))


def two_zeros(model: Model) -> tuple[DataMistake, ...]:
    """Zeros of two joints at once, as another convention of DH tables has them: asked last."""
    return tuple(_zeros(model.robot, 2))


def _mirrored(model: Model) -> Iterator[DataMistake]:
    """Mirrored frames. Where the base is free one reading stands for all: they differ by a turn."""
    if any(isinstance(effect, Base) for effect in model.effects):
        yield DataMistake(
            "mirrored",
            "the points are mirrored (a left-handed frame)",
            "turn the sign of one of x, y and z, or exchange two of them if they were mixed up",
            _points([1.0, -1.0, 1.0]),
        )
        return
    for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        said = f"the points are mirrored ({axis} has the wrong sign)"
        yield DataMistake(f"mirrored {axis}", said, f"turn the sign of {axis}", _points(sign))
    said, remedy = "the points have the wrong sign", "turn the signs of x, y and z"
    yield DataMistake("negated", said, remedy, _points([-1.0, -1.0, -1.0]))


def _units(robot: Robot) -> Iterator[DataMistake]:
    """Units of points, of the joints that slide, and of all that turn, which columns are named by."""
    sliding = " and ".join(np.array(robot.joints)[robot.prismatic].tolist())
    for holds, named in _COLUMNS:
        factor = _METRES[holds] / _METRES[named]
        points, slides = _points([factor] * 3), _scaled(robot, robot.prismatic, factor)
        what, times = f"in {holds}, not in {named}", f"by {factor:.6g}"
        robot_too = "" if "inches" in what else " (or is the robot's file in the wrong unit?)"
        remedy = f"multiply x, y and z {times}{robot_too}"
        yield DataMistake(
            f"points in {holds} for {named}", f"the points are {what}", remedy, points
        )
        if not sliding:
            continue
        said, remedy = f"{sliding} is {what}", f"multiply {sliding} {times}"
        yield DataMistake(f"slides in {holds} for {named}", said, remedy, slides)
        said, remedy = (
            f"the points and {sliding} are {what}",
            f"multiply x, y, z and {sliding} {times}",
        )
        yield DataMistake(f"lengths in {holds} for {named}", said, remedy, _both(points, slides))
    first = robot.joints[int(np.argmin(robot.prismatic))]
    for factor, holds, unit in ((1.0 / _DEGREE, "radians", "deg"), (_DEGREE, "degrees", "rad")):
        yield DataMistake(
            f"joints in {holds}",
            f"the joint angles are {holds} in columns of {unit}",
            f"name the columns {first}_{holds[:3]} and so on",
            _scaled(robot, ~robot.prismatic, factor),
        )


def _joints(robot: Robot) -> Iterator[DataMistake]:
    """One that runs the other way; two that are swapped; one whose drive rides on no link before it."""
    names, eye = robot.joints, np.eye(robot.dof)
    free = np.flatnonzero(robot.free).tolist()
    for k in free:
        yield DataMistake(
            f"{names[k]} reversed",
            f"joint {names[k]} runs the other way",
            f"turn the sign of {names[k]} in the table, or its axis in the robot's file",
            _scaled(robot, np.arange(robot.dof) == k, -1.0),
        )
    for a, b in itertools.combinations(free, 2):
        if robot.prismatic[a] == robot.prismatic[b]:
            yield DataMistake(
                f"{names[a]} and {names[b]} swapped",
                f"joints {names[a]} and {names[b]} are swapped",
                f"exchange the columns of {names[a]} and {names[b]}",
                _mixed(robot, eye[_with_exchanged(robot.dof, a, b)]),
            )
    for k, parent in enumerate(robot.parents[: robot.dof]):
        b = parent - 1
        if b < 0 or robot.prismatic[[b, k]].any():
            continue
        if abs(float(robot.axes[b] @ robot.origins[k, :3, :3] @ robot.axes[k])) < _PARALLEL:
            continue
        for sign, word in ((1.0, "+"), (-1.0, "-")):
            yield DataMistake(
                f"{names[k]} {word} {names[b]}",
                f"joint {names[k]} is given relative to the base and not to the link before it",
                f"put {names[k]} {word} {names[b]} in its place",
                _mixed(robot, eye + sign * np.outer(eye[k], eye[b])),
            )


def _zeros(robot: Robot, count: int) -> Iterator[DataMistake]:
    """Zeros of so many joints that another convention puts a quarter or half a turn away."""
    turning = np.flatnonzero(robot.free & ~robot.prismatic)
    for joints in itertools.combinations(turning, count):
        for turns in itertools.product(_QUARTERS, repeat=count):
            own = [(robot.joints[k], t) for k, t in zip(joints, turns, strict=True)]
            said = [f"the zero of joint {j} is off by {_QUARTERS[t]} deg" for j, t in own]
            add = [f"add {t:g} deg to {j}" for j, t in own]
            offsets = np.zeros(robot.dof)
            offsets[list(joints)] = np.radians(turns)
            yield DataMistake(
                " and ".join(f"{j} off by {_QUARTERS[t]} deg" for j, t in own),
                f"{' and '.join(said)} (another convention)",
                f"{' and '.join(add)} in the table, or move the zero in the robot's file",
                _mixed(robot, np.eye(robot.dof), offsets),
            )


def _renamed(model: Model) -> Iterator[DataMistake]:
    """Two markers exchanged in every reading, which only harms where the cell knows their places."""
    free, names = [bool(row.all()) for row in free_components(model)], model.marker_names
    for a, b in itertools.combinations(range(len(free)), 2):
        if not (free[a] and free[b]):
            yield DataMistake(
                f"{names[a]} and {names[b]} exchanged",
                f"markers {names[a]} and {names[b]} are exchanged",
                "exchange their names in the table or in [markers_mm]",
                partial(reordered, order=_with_exchanged(len(free), a, b)),
            )


def _taken_as_known(model: Model) -> Iterator[DataMistake]:
    """Base or markers that the model takes as known and that are elsewhere, one alone before both."""
    said: dict[type[Effect], tuple[str, str]] = {
        Base: ("base", "the points are not in the robot's base frame"),
        Tool: ("tool", "the markers are not where [markers_mm] says"),
    }
    lacks = [own for kind, own in said.items() if not len(model.where(kind))]
    for count in range(1, len(lacks) + 1):
        for own in itertools.combinations(lacks, count):
            names = [name for name, _ in own]
            yield DataMistake(
                f"{' and '.join(names)} taken as known",
                ", and ".join(what for _, what in own),
                "add " + " and ".join(f'"{name}"' for name in names) + " to [model] effects",
                lambda data: data,
                partial(_free, names),
            )


def _free(names: list[str], model: Model, data: Measurements) -> Model:
    """The model with base or markers found from the readings of one station."""
    found: list[Effect] = []
    if "base" in names:
        found.append(Base("base", int(data.poses.station[0])))
    if "tool" in names:
        found += [Tool(f"marker:{name}", j) for j, name in enumerate(model.marker_names)]
    return model.with_effects((*found, *model.effects))


def _points(factors: Array | list[float]) -> Undo:
    return lambda data: replace(data, readings=data.points * factors)


def _scaled(robot: Robot, which: Mask, factor: float) -> Undo:
    return _mixed(robot, np.diag(np.where(which, factor, 1.0)))


def _mixed(robot: Robot, matrix: Array, offsets: Array | float = 0.0) -> Undo:
    """Other joint values; those that follow others go with them."""

    def undone(data: Measurements) -> Measurements:
        q = data.poses.q @ matrix.T + offsets
        q = robot.tied(q) if robot.follows(data.poses.q) else q
        return replace(data, poses=replace(data.poses, q=q))

    return undone


def _both(first: Undo, second: Undo) -> Undo:
    return lambda data: second(first(data))


def _with_exchanged(count: int, a: int, b: int) -> IntArray:
    order = np.arange(count)
    order[[a, b]] = b, a
    return order


def reordered(data: Measurements, order: IntArray) -> Measurements:
    """The readings with the markers of each pose in another order, (m, M), or (M,) of all poses."""
    order = np.broadcast_to(order, data.seen.shape)
    return replace(
        data,
        readings=np.take_along_axis(data.points, order[..., None], axis=1),
        seen=np.take_along_axis(data.seen, order, axis=1),
        sigma=np.take_along_axis(data.sigma, order, axis=1),
    )
