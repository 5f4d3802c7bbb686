"""What people get wrong when they write down joints and points, one entry each.

Every entry undoes its mistake. None of them is an error that an arm has: an arm errs by a small part
of its size, and these move every point by a large one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.base import Base
from calib.effects.protocol import Effect
from calib.effects.tool import Tool
from calib.identification.misplaced import reordered
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_INCH, _DEGREE = 0.0254, np.pi / 180.0
_PARALLEL = 0.99  # cosine between axes


@dataclass(frozen=True, eq=False)
class Slip:
    """One mistake.

    name : str; said : str, what is wrong; remedy : str, what to do
    undone : the measurements as they would read without it
    freed : the model that does not presume what is wrong
    """

    name: str
    said: str
    remedy: str
    undone: Callable[[Measurements], Measurements]
    freed: Callable[[Model, Measurements], Model] = lambda model, _: model


def slips(model: Model) -> tuple[Slip, ...]:
    """All that could have been got wrong with this arm and these markers."""
    robot = model.robot
    return (
        *_signs(model),
        *_lengths(robot),
        *_angles(robot),
        *_reversed(robot),
        *_zeros(robot, 1),
        *_swapped(robot),
        *_counted_from_the_base(robot),
        *_renamed(model),
    )


def _signs(model: Model) -> Iterator[Slip]:
    """Mirrored frames. Where the base is free one reading stands for all: they differ by a turn."""
    if any(isinstance(effect, Base) for effect in model.effects):
        yield Slip(
            "mirrored",
            "the points are mirrored (a left-handed frame)",
            "turn the sign of one of x, y and z, or exchange two of them if they were mixed up",
            _points(np.array([1.0, -1.0, 1.0])),
        )
        return
    for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        said = f"the points are mirrored ({axis} has the wrong sign)"
        yield Slip(f"mirrored {axis}", said, f"turn the sign of {axis}", _points(sign))
    yield Slip(
        "negated",
        "the points have the wrong sign",
        "turn the signs of x, y and z",
        _points(-np.ones(3)),
    )


def _lengths(robot: Robot) -> Iterator[Slip]:
    """Units of points, and of the joints that slide."""
    for factor, holds, named in (
        (1e3, "metres", "millimetres"),
        (1e-3, "millimetres", "metres"),
        (_INCH * 1e3, "inches", "millimetres"),
        (1e-3 / _INCH, "millimetres", "inches"),
        (_INCH, "inches", "metres"),
        (1.0 / _INCH, "metres", "inches"),
    ):
        what, remedy = f"in {holds}, not in {named}", f"by {factor:.6g}"
        yield Slip(
            f"points in {holds} for {named}",
            f"the points are {what}",
            f"multiply x, y and z {remedy}" + (_OR_THE_ROBOT if "inches" not in what else ""),
            _points(np.full(3, factor)),
        )
        if robot.prismatic.any():
            slides = _scaled(robot, np.where(robot.prismatic, factor, 1.0))
            joints = " and ".join(
                n for n, s in zip(robot.joints, robot.prismatic, strict=True) if s
            )
            yield Slip(
                f"slides in {holds} for {named}",
                f"{joints} is {what}",
                f"multiply {joints} {remedy}",
                slides,
            )
            yield Slip(
                f"lengths in {holds} for {named}",
                f"the points and {joints} are {what}",
                f"multiply x, y, z and {joints} {remedy}",
                _after(slides, _points(np.full(3, factor))),
            )


_OR_THE_ROBOT = " (or is the robot's file in the wrong unit?)"


def _angles(robot: Robot) -> Iterator[Slip]:
    """Degrees and radians, of all joints at once: the columns' names say which they should be."""
    for factor, holds, unit in ((1.0 / _DEGREE, "radians", "deg"), (_DEGREE, "degrees", "rad")):
        joint = robot.joints[int(np.argmin(robot.prismatic))]
        yield Slip(
            f"joints in {holds}",
            f"the joint angles are {holds} in columns of {unit}",
            f"name the columns {joint}_{holds[:3]} and so on",
            _scaled(robot, np.where(robot.prismatic, 1.0, factor)),
        )


def _reversed(robot: Robot) -> Iterator[Slip]:
    for k in np.flatnonzero(robot.free):
        joint = robot.joints[k]
        yield Slip(
            f"{joint} reversed",
            f"joint {joint} runs the other way",
            f"turn the sign of {joint} in the table, or its axis in the robot's file",
            _scaled(robot, np.where(np.arange(robot.dof) == k, -1.0, 1.0)),
        )


def two_zeros(model: Model) -> tuple[Slip, ...]:
    """Zeros of two joints at once, as another convention of DH tables has them: asked last."""
    return tuple(_zeros(model.robot, 2))


def _zeros(robot: Robot, count: int) -> Iterator[Slip]:
    """Zeros of so many joints that another convention puts a quarter or half a turn away."""
    turning = np.flatnonzero(robot.free & ~robot.prismatic)
    for joints in itertools.combinations(turning, count):
        for turns in itertools.product(_QUARTERS, repeat=count):
            offsets = np.zeros(robot.dof)
            offsets[list(joints)] = np.radians(turns)
            own = [(robot.joints[k], turn) for k, turn in zip(joints, turns, strict=True)]
            off = [f"the zero of joint {joint} is off by {_size(turn)} deg" for joint, turn in own]
            add = [f"add {turn:g} deg to {joint}" for joint, turn in own]
            yield Slip(
                " and ".join(f"{joint} off by {_size(turn)} deg" for joint, turn in own),
                f"{' and '.join(off)} (another convention)",
                f"{' and '.join(add)} in the table, or move the zero in the robot's file",
                _mixed(robot, np.eye(robot.dof), offsets),
            )


_QUARTERS = (-90.0, 90.0, 180.0)


def _size(turn: float) -> str:
    """The offset of a table that a turn mends; half a turn has no sign."""
    return f"{-turn:g}" if abs(turn) < 180.0 else "180"


def _swapped(robot: Robot) -> Iterator[Slip]:
    for a, b in itertools.combinations(np.flatnonzero(robot.free), 2):
        if robot.prismatic[a] != robot.prismatic[b]:
            continue
        one, other = robot.joints[a], robot.joints[b]
        mixed = np.eye(robot.dof)
        mixed[[a, b]] = mixed[[b, a]]
        yield Slip(
            f"{one} and {other} swapped",
            f"joints {one} and {other} are swapped",
            f"exchange the columns of {one} and {other}",
            _mixed(robot, mixed),
        )


def _counted_from_the_base(robot: Robot) -> Iterator[Slip]:
    """A joint whose angle is that to the base: its drive does not ride on the link before it."""
    for k, parent in enumerate(robot.parents[: robot.dof]):
        b = parent - 1
        if b < 0 or robot.prismatic[[b, k]].any():
            continue
        if abs(float(robot.axes[b] @ robot.origins[k, :3, :3] @ robot.axes[k])) < _PARALLEL:
            continue
        before, joint = robot.joints[b], robot.joints[k]
        for sign, word in ((1.0, "+"), (-1.0, "-")):
            mixed = np.eye(robot.dof)
            mixed[k, b] = sign
            yield Slip(
                f"{joint} {word} {before}",
                f"joint {joint} is given relative to the base and not to the link before it",
                f"put {joint} {word} {before} in its place",
                _mixed(robot, mixed),
            )


def _renamed(model: Model) -> Iterator[Slip]:
    """Two markers exchanged in every reading, which only harms where the cell knows their places."""
    free = [bool(row.all()) for row in free_components(model)]
    for a, b in itertools.combinations(range(len(free)), 2):
        if free[a] and free[b]:
            continue
        one, other = model.marker_names[a], model.marker_names[b]
        order = np.arange(len(free))
        order[[a, b]] = b, a
        yield Slip(
            f"{one} and {other} exchanged",
            f"markers {one} and {other} are exchanged",
            "exchange their names in the table or in [markers_mm]",
            partial(reordered, order=order),
        )


def taken_as_known(model: Model) -> tuple[Slip, ...]:
    """Base or markers that the model takes as known and that are elsewhere, one alone before both."""
    kinds: dict[str, type[Effect]] = {"base": Base, "tool": Tool}
    lacks = [name for name, kind in kinds.items() if not len(model.where(kind))]
    said = {
        "base": "the points are not in the robot's base frame",
        "tool": "the markers are not where [markers_mm] says",
    }
    sets = [*((name,) for name in lacks), *([tuple(lacks)] if len(lacks) > 1 else [])]
    return tuple(
        Slip(
            f"{' and '.join(names)} taken as known",
            ", and ".join(said[name] for name in names),
            "add " + " and ".join(f'"{name}"' for name in names) + " to [model] effects",
            lambda data: data,
            partial(_free, names),
        )
        for names in sets
    )


def _free(names: tuple[str, ...], model: Model, data: Measurements) -> Model:
    """The model with base or markers found from the readings of one station."""
    found: list[Effect] = []
    if "base" in names:
        found.append(Base("base", int(data.poses.station[0])))
    if "tool" in names:
        found += [Tool(f"marker:{name}", j) for j, name in enumerate(model.marker_names)]
    return model.with_effects((*found, *model.effects))


def _points(factors: Array) -> Callable[[Measurements], Measurements]:
    return lambda data: replace(data, readings=data.points * factors)


def _scaled(robot: Robot, factors: Array) -> Callable[[Measurements], Measurements]:
    return _mixed(robot, np.diag(factors))


def _mixed(
    robot: Robot, matrix: Array, offsets: Array | float = 0.0
) -> Callable[[Measurements], Measurements]:
    """Other joint values; those that follow others go with them."""

    def undone(data: Measurements) -> Measurements:
        q = data.poses.q @ matrix.T + offsets
        q = robot.tied(q) if robot.follows(data.poses.q) else q
        return replace(data, poses=replace(data.poses, q=q))

    return undone


def _after(
    first: Callable[[Measurements], Measurements], second: Callable[[Measurements], Measurements]
) -> Callable[[Measurements], Measurements]:
    return lambda data: second(first(data))
