"""What people get wrong when they write down joints and points, one entry each.

Every entry undoes its mistake. None of them is an error that an arm has: an arm errs by a small part
of its size, and these move every point by a large one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.effects.protocol import Effect
from calib.effects.tool_base import Base, Tool
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_PARALLEL = 0.99  # cosine between axes
# A turn, in deg, that mends a zero, and by how much that is off; half a turn has no sign.
_QUARTERS = {-90.0: "90", 90.0: "-90", 180.0: "180"}
_METRES = {"metres": 1.0, "millimetres": 1e-3, "inches": 0.0254}
_PAIRS = ("metres", "millimetres"), ("inches", "millimetres"), ("inches", "metres")
_ELSEWHERE: dict[str, tuple[type[Effect], str]] = {
    "base": (Base, "the points are not in the robot's base frame"),
    "tool": (Tool, "the markers are not where [markers_mm] says"),
}


@dataclass(frozen=True, eq=False)
class DataMistake:
    """One mistake, and what undoes it.

    name : str; said : str, what is wrong; remedy : str, what to do
    points : factors of the coordinates; order : ndarray of int, shape (M,), of the markers
    joints, zeros : ndarrays, shapes (n, n) and (n,), by which joint values are mixed and shifted
    frees : effects, of "base" and "tool", that the model takes as known and that are elsewhere
    """

    name: str
    said: str
    remedy: str
    points: Array | list[float] | float = 1.0
    joints: Array | None = None
    zeros: Array | float = 0.0
    order: IntArray | None = None
    frees: tuple[str, ...] = ()

    def undone(self, model: Model, data: Measurements) -> tuple[Model, Measurements]:
        """Model and measurements as they would be without it, of one station.

        Joints that follow others go with them; what was taken as known is free.
        """
        effects: list[Effect] = []
        if "base" in self.frees:
            effects.append(Base("base", int(data.poses.station[0])))
        if "tool" in self.frees:
            effects += [Tool(f"marker:{name}", j) for j, name in enumerate(model.marker_names)]
        robot = model.robot
        model = model.with_effects((*effects, *model.effects)) if effects else model
        data = replace(data, readings=data.points * self.points)
        if self.order is not None:
            data = reordered(data, self.order)
        if self.joints is None:
            return model, data
        q = data.poses.q @ self.joints.T + self.zeros
        q = robot.tied(q) if robot.follows(data.poses.q) else q
        return model, replace(data, poses=replace(data.poses, q=q))


def tables(model: Model) -> Iterator[tuple[DataMistake, ...]]:
    """All that could be wrong with every reading of this arm and these markers, likelier ones first.

    Of the entries of one table several may explain the same readings.
    """
    robot = model.robot
    yield *_mirrored(model), *_units(robot), *_joints(robot), *_zeros(robot, 1), *_renamed(model)
    yield from ((mistake,) for mistake in _taken_as_known(model))


def two_zeros(model: Model) -> tuple[DataMistake, ...]:
    """Zeros of two joints at once, as another convention of DH tables has them: asked last."""
    return tuple(_zeros(model.robot, 2))


def _mirrored(model: Model) -> Iterator[DataMistake]:
    """Mirrored frames. Where the base is free one reading stands for all: they differ by a turn."""
    if any(isinstance(effect, Base) for effect in model.effects):
        said = "the points are mirrored (a left-handed frame)"
        remedy = "turn the sign of one of x, y and z, or exchange two of them if they were mixed up"
        yield DataMistake("mirrored", said, remedy, points=[1.0, -1.0, 1.0])
        return
    for axis, signs in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        said, remedy = (
            f"the points are mirrored ({axis} has the wrong sign)",
            f"turn the sign of {axis}",
        )
        yield DataMistake(f"mirrored {axis}", said, remedy, points=signs)
    said, remedy = "the points have the wrong sign", "turn the signs of x, y and z"
    yield DataMistake("negated", said, remedy, points=-1.0)


def _units(robot: Robot) -> Iterator[DataMistake]:
    """Units of points, of the joints that slide, and of all that turn, which columns are named by."""
    slides, first = robot.prismatic, robot.joints[int(np.argmin(robot.prismatic))]
    sliding = " and ".join(np.array(robot.joints)[slides].tolist())
    for a, b in (both for pair in _PAIRS for both in (pair, pair[::-1])):
        factor, unit = _METRES[a] / _METRES[b], f"in {a} for {b}"
        slid, times = np.diag(np.where(slides, factor, 1.0)), f"by {factor:.6g}"
        also = "" if "inches" in (a, b) else " (or is the robot's file in the wrong unit?)"
        texts = f"the points are in {a}, not in {b}", f"multiply x, y and z {times}{also}"
        yield DataMistake(f"points {unit}", *texts, points=factor)
        if sliding:
            texts = f"{sliding} is in {a}, not in {b}", f"multiply {sliding} {times}"
            yield DataMistake(f"slides {unit}", *texts, joints=slid)
            said = f"the points and {sliding} are in {a}, not in {b}"
            remedy = f"multiply x, y, z and {sliding} {times}"
            yield DataMistake(f"lengths {unit}", said, remedy, points=factor, joints=slid)
    for factor, a, b in ((180.0 / np.pi, "radians", "deg"), (np.pi / 180.0, "degrees", "rad")):
        said, remedy = f"the joint angles are {a} in columns of {b}", f"{first}_{a:.3} and so on"
        joints = np.diag(np.where(slides, 1.0, factor))
        yield DataMistake(f"joints in {a}", said, f"name the columns {remedy}", joints=joints)


def _joints(robot: Robot) -> Iterator[DataMistake]:
    """One that runs the other way; two that are swapped; one whose drive rides on no link before it."""
    names, eye, free = robot.joints, np.eye(robot.dof), np.flatnonzero(robot.free).tolist()
    for k in free:
        remedy = f"turn the sign of {names[k]} in the table, or its axis in the robot's file"
        texts = f"{names[k]} reversed", f"joint {names[k]} runs the other way", remedy
        yield DataMistake(*texts, joints=np.diag(1.0 - 2.0 * eye[k]))
    for a, b in itertools.combinations(free, 2):
        if robot.prismatic[a] == robot.prismatic[b]:
            both, joints = f"{names[a]} and {names[b]}", eye[_exchanged(robot.dof, a, b)]
            texts = (
                f"{both} swapped",
                f"joints {both} are swapped",
                f"exchange the columns of {both}",
            )
            yield DataMistake(*texts, joints=joints)
    for k, parent in enumerate(robot.parents[: robot.dof]):
        b = parent - 1
        if b < 0 or robot.prismatic[[b, k]].any():
            continue
        if abs(float(robot.axes[b] @ robot.origins[k, :3, :3] @ robot.axes[k])) < _PARALLEL:
            continue
        said = f"joint {names[k]} is given relative to the base and not to the link before it"
        for sign, word in ((1.0, "+"), (-1.0, "-")):
            sum_, joints = f"{names[k]} {word} {names[b]}", eye + sign * np.outer(eye[k], eye[b])
            yield DataMistake(sum_, said, f"put {sum_} in its place", joints=joints)


def _zeros(robot: Robot, count: int) -> Iterator[DataMistake]:
    """Zeros of so many joints that another convention puts a quarter or half a turn away."""
    turning = np.flatnonzero(robot.free & ~robot.prismatic)
    for joints in itertools.combinations(turning, count):
        for turns in itertools.product(_QUARTERS, repeat=count):
            own = [(robot.joints[k], _QUARTERS[t], t) for k, t in zip(joints, turns, strict=True)]
            name = " and ".join(f"{joint} off by {off} deg" for joint, off, _ in own)
            said = " and ".join(f"the zero of joint {j} is off by {off} deg" for j, off, _ in own)
            add = " and ".join(f"add {turn:g} deg to {joint}" for joint, _, turn in own)
            texts = (
                f"{said} (another convention)",
                f"{add} in the table, or move the zero in the robot's file",
            )
            zeros = np.zeros(robot.dof)
            zeros[list(joints)] = np.radians(turns)
            yield DataMistake(name, *texts, joints=np.eye(robot.dof), zeros=zeros)


def _renamed(model: Model) -> Iterator[DataMistake]:
    """Two markers exchanged in every reading, which only harms where the cell knows their places."""
    free, names = np.asarray(free_components(model).all(axis=1)), model.marker_names
    for a, b in itertools.combinations(range(len(free)), 2):
        if not (free[a] and free[b]):
            both, remedy = f"{names[a]} and {names[b]}", "in the table or in [markers_mm]"
            texts = f"markers {both} are exchanged", f"exchange their names {remedy}"
            yield DataMistake(f"{both} exchanged", *texts, order=_exchanged(len(free), a, b))


def _taken_as_known(model: Model) -> Iterator[DataMistake]:
    """Base or markers that the model takes as known and that are elsewhere, one alone before both."""
    lacking = [name for name, (kind, _) in _ELSEWHERE.items() if not len(model.where(kind))]
    for count in range(1, len(lacking) + 1):
        for names in itertools.combinations(lacking, count):
            said = ", and ".join(_ELSEWHERE[name][1] for name in names)
            remedy = " and ".join(f'"{name}"' for name in names)
            texts = said, f"add {remedy} to [model] effects"
            yield DataMistake(f"{' and '.join(names)} taken as known", *texts, frees=names)


def _exchanged(count: int, a: int, b: int) -> IntArray:
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
