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
_TEXTS = {
    "mirrored": (
        "the points are mirrored (a left-handed frame)",
        "turn the sign of one of x, y and z, or exchange two of them if they were mixed up",
    ),
    "mirrored {a}": ("the points are mirrored ({a} has the wrong sign)", "turn the sign of {a}"),
    "negated": ("the points have the wrong sign", "turn the signs of x, y and z"),
    "points in {a} for {b}": (
        "the points are in {a}, not in {b}",
        "multiply x, y and z by {times}",
    ),
    "slides in {a} for {b}": ("{joints} is in {a}, not in {b}", "multiply {joints} by {times}"),
    "lengths in {a} for {b}": (
        "the points and {joints} are in {a}, not in {b}",
        "multiply x, y, z and {joints} by {times}",
    ),
    "joints in {a}": (
        "the joint angles are {a} in columns of {b}",
        "name the columns {first}_{a:.3} and so on",
    ),
    "{a} reversed": (
        "joint {a} runs the other way",
        "turn the sign of {a} in the table, or its axis in the robot's file",
    ),
    "{a} and {b} swapped": (
        "joints {a} and {b} are swapped",
        "exchange the columns of {a} and {b}",
    ),
    "{a} {sign} {b}": (
        "joint {a} is given relative to the base and not to the link before it",
        "put {a} {sign} {b} in its place",
    ),
    "{off}": (
        "{zeros} (another convention)",
        "{add} in the table, or move the zero in the robot's file",
    ),
    "{a} and {b} exchanged": (
        "markers {a} and {b} are exchanged",
        "exchange their names in the table or in [markers_mm]",
    ),
    "{a} taken as known": ("{elsewhere}", "add {effects} to [model] effects"),
}
"""Name of a mistake -> what is wrong, and what to do."""


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

    def freed(self, model: Model, data: Measurements) -> Model:
        """The model that finds what it took as known from the readings of one station."""
        effects: list[Effect] = []
        if "base" in self.frees:
            effects.append(Base("base", int(data.poses.station[0])))
        if "tool" in self.frees:
            effects += [Tool(f"marker:{name}", j) for j, name in enumerate(model.marker_names)]
        return model.with_effects((*effects, *model.effects)) if effects else model

    def undone(self, robot: Robot, data: Measurements) -> Measurements:
        """The measurements as they would read without it; joints that follow others go with them."""
        data = replace(data, readings=data.points * self.points)
        if self.order is not None:
            data = reordered(data, self.order)
        if self.joints is None:
            return data
        q = data.poses.q @ self.joints.T + self.zeros
        q = robot.tied(q) if robot.follows(data.poses.q) else q
        return replace(data, poses=replace(data.poses, q=q))


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


def _entry(name: str, words: dict[str, str] | None = None, **undo: object) -> DataMistake:
    texts = (text.format(**(words or {})) for text in (name, *_TEXTS[name]))
    return DataMistake(*texts, **undo)  # type: ignore[arg-type]


def _mirrored(model: Model) -> Iterator[DataMistake]:
    """Mirrored frames. Where the base is free one reading stands for all: they differ by a turn."""
    if any(isinstance(effect, Base) for effect in model.effects):
        yield _entry("mirrored", points=[1.0, -1.0, 1.0])
        return
    for axis, signs in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        yield _entry("mirrored {a}", {"a": axis}, points=signs)
    yield _entry("negated", points=-1.0)


def _units(robot: Robot) -> Iterator[DataMistake]:
    """Units of points, of the joints that slide, and of all that turn, which columns are named by."""
    slides, first = robot.prismatic, robot.joints[int(np.argmin(robot.prismatic))]
    sliding = " and ".join(np.array(robot.joints)[slides].tolist())
    for a, b in (both for pair in _PAIRS for both in (pair, pair[::-1])):
        factor = _METRES[a] / _METRES[b]
        joints = np.diag(np.where(slides, factor, 1.0))
        words = {"a": a, "b": b, "joints": sliding, "times": f"{factor:.6g}"}
        robot_too = "" if "inches" in (a, b) else " (or is the robot's file in the wrong unit?)"
        also = words | {"times": words["times"] + robot_too}
        yield _entry("points in {a} for {b}", also, points=factor)
        if sliding:
            yield _entry("slides in {a} for {b}", words, joints=joints)
            yield _entry("lengths in {a} for {b}", words, points=factor, joints=joints)
    for factor, a, b in ((180.0 / np.pi, "radians", "deg"), (np.pi / 180.0, "degrees", "rad")):
        joints = np.diag(np.where(slides, 1.0, factor))
        yield _entry("joints in {a}", {"a": a, "b": b, "first": first}, joints=joints)


def _joints(robot: Robot) -> Iterator[DataMistake]:
    """One that runs the other way; two that are swapped; one whose drive rides on no link before it."""
    names, eye, free = robot.joints, np.eye(robot.dof), np.flatnonzero(robot.free).tolist()
    for k in free:
        yield _entry("{a} reversed", {"a": names[k]}, joints=np.diag(1.0 - 2.0 * eye[k]))
    for a, b in itertools.combinations(free, 2):
        if robot.prismatic[a] == robot.prismatic[b]:
            words, joints = {"a": names[a], "b": names[b]}, eye[_exchanged(robot.dof, a, b)]
            yield _entry("{a} and {b} swapped", words, joints=joints)
    for k, parent in enumerate(robot.parents[: robot.dof]):
        b = parent - 1
        if b < 0 or robot.prismatic[[b, k]].any():
            continue
        if abs(float(robot.axes[b] @ robot.origins[k, :3, :3] @ robot.axes[k])) < _PARALLEL:
            continue
        for sign, word in ((1.0, "+"), (-1.0, "-")):
            words = {"a": names[k], "b": names[b], "sign": word}
            yield _entry("{a} {sign} {b}", words, joints=eye + sign * np.outer(eye[k], eye[b]))


def _zeros(robot: Robot, count: int) -> Iterator[DataMistake]:
    """Zeros of so many joints that another convention puts a quarter or half a turn away."""
    turning = np.flatnonzero(robot.free & ~robot.prismatic)
    each = ("{} off by {} deg", "the zero of joint {} is off by {} deg", "add {2:g} deg to {0}")
    for joints in itertools.combinations(turning, count):
        for turns in itertools.product(_QUARTERS, repeat=count):
            own = [(robot.joints[k], _QUARTERS[t], t) for k, t in zip(joints, turns, strict=True)]
            texts = (" and ".join(text.format(*one) for one in own) for text in each)
            zeros = np.zeros(robot.dof)
            zeros[list(joints)] = np.radians(turns)
            words = dict(zip(("off", "zeros", "add"), texts, strict=True))
            yield _entry("{off}", words, joints=np.eye(robot.dof), zeros=zeros)


def _renamed(model: Model) -> Iterator[DataMistake]:
    """Two markers exchanged in every reading, which only harms where the cell knows their places."""
    free, names = np.asarray(free_components(model).all(axis=1)), model.marker_names
    for a, b in itertools.combinations(range(len(free)), 2):
        if not (free[a] and free[b]):
            words, order = {"a": names[a], "b": names[b]}, _exchanged(len(free), a, b)
            yield _entry("{a} and {b} exchanged", words, order=order)


def _taken_as_known(model: Model) -> Iterator[DataMistake]:
    """Base or markers that the model takes as known and that are elsewhere, one alone before both."""
    elsewhere = {
        "base": "the points are not in the robot's base frame",
        "tool": "the markers are not where [markers_mm] says",
    }
    lacking = [
        name for kind, name in ((Base, "base"), (Tool, "tool")) if not len(model.where(kind))
    ]
    for count in range(1, len(lacking) + 1):
        for names in itertools.combinations(lacking, count):
            words = {
                "a": " and ".join(names),
                "elsewhere": ", and ".join(elsewhere[name] for name in names),
                "effects": " and ".join(f'"{name}"' for name in names),
            }
            yield _entry("{a} taken as known", words, frees=names)


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
