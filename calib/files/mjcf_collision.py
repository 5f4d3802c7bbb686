"""Capsules of the arm from the collision geoms of an MJCF, one for each, as MuJoCo compiles them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import rotate
from calib.arrays import Array
from calib.errors import InputError
from calib.files.collision import capsule_about, corners, rims
from calib.files.in_mujoco import mujoco_for
from calib.files.mjcf import placed, shifted
from calib.files.mjcf_tree import WORLD


def mjcf_shapes(path: Path, base: str, tip: str) -> Shapes:
    """Capsules by the joint that carries them, or ``base``, in the frame that turns with the joint.

    Each holds its geom; one that touches nothing (``contype`` and ``conaffinity`` zero) is a picture
    and left out. Bodies beside the chain are held as they are drawn. A geom that no capsule holds,
    such as a plane, is named with its reason.
    """
    try:
        with mujoco_for(path) as mujoco:
            model = mujoco.MjModel.from_xml_path(str(path))
    except InputError as error:
        return Shapes({}, (f"its geoms ({error.what})",))
    capsules: dict[str, list[Capsule]] = {}
    unread, lowest = [], []
    frames = _frames(model, base, tip)
    for g in np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0):
        body = int(model.geom_bodyid[g])
        if body not in frames:
            continue
        spanned = _spanned(mujoco, model, int(g))
        if spanned is None:
            unread.append(f"{model.body(body).name} ({_kind(mujoco, model, int(g))} has no end)")
            continue
        carrier, T = frames[body]
        T = T @ placed(model.geom_pos[g], model.geom_quat[g])
        points = rotate(T[:3, :3], spanned[0]) + T[:3, 3]
        if carrier == "base":
            lowest.append(float(points[:, 2].min()) - spanned[1])
        capsules.setdefault(carrier, []).append(capsule_about(points, spanned[1]))
    found = {name: tuple(own) for name, own in capsules.items()}
    return Shapes(found, tuple(unread), min(lowest, default=None))


def _frames(model: Any, base: str, tip: str) -> dict[int, tuple[str, Array]]:
    """Of every body of the arm its carrier, and its frame in the carrier's, shape (4, 4).

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.
    """
    first = 0 if base == WORLD else model.body(base).id
    chain = [*_up_to(model, _body_of(model, tip), first)][::-1]
    frames: dict[int, tuple[str, Array]] = {first: ("base", np.eye(4))}
    for i in range(1, model.nbody):  # parents come first
        parent, joints = int(model.body_parentid[i]), np.flatnonzero(model.jnt_bodyid == i)
        if i == first or parent not in frames or (i not in chain and parent == 0):
            continue
        carrier, T = frames[parent]
        T = T @ placed(model.body_pos[i], model.body_quat[i])
        if len(joints) and i in chain:
            carrier, T = model.joint(joints[-1]).name, shifted(-model.jnt_pos[joints[-1]])
        frames[i] = carrier, T
    return {body: own for body, own in frames.items() if body}


def _body_of(model: Any, tip: str) -> int:
    try:
        return int(model.body(tip).id)
    except KeyError:
        return int(model.site_bodyid[model.site(tip).id])


def _up_to(model: Any, body: int, first: int) -> Iterator[int]:
    """Bodies from the tip's up to the base, itself left out."""
    while body != first:
        yield body
        body = int(model.body_parentid[body])


def _spanned(mujoco: Any, model: Any, g: int) -> tuple[Array, float] | None:
    """Points (n, 3), m, in the geom's frame, and a radius about them; None of what has no end."""
    Geom, (a, b, c) = mujoco.mjtGeom, model.geom_size[g].tolist()
    kind = model.geom_type[g]
    if kind == Geom.mjGEOM_BOX:
        return corners(np.array([a, b, c])), 0.0
    if kind == Geom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), a
    if kind == Geom.mjGEOM_CYLINDER:
        return rims(a, b), 0.0
    if kind == Geom.mjGEOM_CAPSULE:
        return np.outer([-b, b], [0.0, 0.0, 1.0]), a
    if kind == Geom.mjGEOM_ELLIPSOID:
        return _ellipsoid(model.geom_size[g])
    if kind == Geom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[g]))
        begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        return np.array(model.mesh_vert[begin : begin + count], dtype=float), 0.0
    return None


def _ellipsoid(half: Array) -> tuple[Array, float]:
    """The ball of the second axis, moved along the first: it meets the ellipsoid at its ends."""
    first, second = np.argsort(half)[[2, 1]]
    return np.outer([-1.0, 1.0], np.eye(3)[first] * (half[first] - half[second])), float(
        half[second]
    )


def _kind(mujoco: Any, model: Any, g: int) -> str:
    name = mujoco.mjtGeom(int(model.geom_type[g])).name
    return str(name.removeprefix("mjGEOM_").lower())
