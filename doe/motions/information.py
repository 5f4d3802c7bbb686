"""What each motion tells of the parameters of the torque: from the products of its columns.

Residuals of real arms are a few percent of the torque and remember themselves for some tenths of a
second, so that a motion is worth one independent sample of every joint in that time, not one a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.errors import CalibError, UnknownEffect
from calib.motion.effects import EFFECTS, INERTIALS, KINDS, NAMES, PAYLOAD, SCALE, Stated
from calib.motion.fit import sizes_of
from calib.motion.gram import FILE, LOSSES, Products, products
from calib.motion.motions import Motions
from calib.motion.regressor import PER_LINK
from doe.motions.draw import Motion

RESIDUAL, MEMORY = 0.05, 0.4  # of the torque's RMS; s
USUAL = (
    *("torque_offset", "coulomb_friction", "viscous_friction", "armature", "pre_sliding"),
    INERTIALS,
)
"""The model of a design where the cell names no term of the torque."""
_SIZE = 0.1  # of the torque, and of masses: a plausible size of a parameter
_OF_LINK = ("mass", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_OPEN = 3e-3  # of a column, in amplitude: where others leave less of it, it is open


@dataclass(frozen=True)
class TorqueParameter:
    """A parameter, SI; size : plausible one; links : whether it is one of the inertials."""

    effect: str
    where: str
    name: str
    unit: str
    size: float
    links: bool = False


@dataclass(frozen=True, eq=False)
class Information:
    """Of r motions.

    parameters : those that the motions determine; open : names of the inertials that others stand for
    M : ndarray, shape (r, p, p), in plausible sizes, of independent samples
    rivals : two arrays of int, positions of rivals, or None
    """

    parameters: tuple[TorqueParameter, ...]
    open: tuple[str, ...]
    M: Array
    rivals: tuple[IntArray, IntArray] | None


def information(
    cell: Cell, motions: Sequence[Motion], effects: Sequence[str], rivals: Sequence[str]
) -> Information:
    """Information of every motion about the terms of the model, and about both rivals.

    Raises UnknownEffect; CalibError for rivals that no motion tells apart.
    """
    parts = [products(
        cell.robot, Motions((own.run(cell),)), KINDS, gravity=cell.gravity,
        stated=Stated(cell.gear_ratios, cell.anchors), payload=own.payload, cutoff=cell.motion.cutoff,
    ) for own in motions]  # fmt: skip
    torque = np.mean([_power(own) for own in parts], axis=0) ** 0.5
    torque = np.maximum(torque, 1e-3 * float(torque.max()))
    of_text = {text: _columns(cell, parts, text, torque) for text in (*effects, *rivals)}
    found = {column: own for each in of_text.values() for column, own in each.items()}
    columns, named = tuple(found), tuple(found.values())
    M = np.array([_of_one(own, columns, named, torque, motion.lasts)
                  for own, motion in zip(parts, motions, strict=True)])  # fmt: skip
    kept = _determined(M.mean(axis=0), np.array([p.links for p in named]))
    gone = np.setdiff1d(np.arange(len(named)), kept)
    if unseen := [f"{named[i].effect}:{named[i].where}" for i in gone if not named[i].links]:
        raise CalibError(
            f"no motion tells {unseen[0]} from the rest; take it out of [model] effects"
        )
    places = [np.flatnonzero([columns[i] in of_text[own] for i in kept]) for own in rivals]
    for text, place in zip(rivals, places, strict=True):
        if not len(place):
            raise CalibError(f"{text}: the rest of the model makes the same torque in every motion")
    if rivals and len(np.intersect1d(places[0], places[1])):
        raise CalibError(f"{rivals[0]} and {rivals[1]} share parameters; name two that do not")
    return Information(
        tuple(named[i] for i in kept),
        tuple(f"{named[i].where}.{named[i].name}" for i in gone),
        M[:, kept[:, None], kept],
        (places[0], places[1]) if rivals else None,
    )


@dataclass(frozen=True)
class _Column:
    """Where a parameter acts: a place of joints' columns; of one joint, or of all where None.

    scale : whether it multiplies the nominal torque of the joint, in the place of a column
    """

    at: int
    joint: int | None
    scale: bool = False


def _columns(
    cell: Cell, parts: Sequence[Products], text: str, torque: Array
) -> dict[_Column, TorqueParameter]:
    """Parameters of ``kind`` or ``kind:where[,where]``. Raises UnknownEffect."""
    kind, _, rest = text.partition(":")
    joints, first = cell.robot.joints, parts[0]
    where = [own.strip() for own in rest.split(",")] if rest else list(joints)
    if kind not in NAMES:
        raise UnknownEffect(f"{kind!r} is no term of a torque; known are {', '.join(NAMES)}")
    if kind in (PAYLOAD, INERTIALS):
        sizes, n = _SIZE * sizes_of(first), len(joints)
        first_place = PER_LINK * (n - 1) if kind == PAYLOAD else 0
        return {
            _Column(at, None): TorqueParameter(
                kind, joints[at // PER_LINK], _OF_LINK[at % PER_LINK],
                _unit(at % PER_LINK), float(sizes[at]), links=True,
            )
            for at in range(first_place, PER_LINK * n)
        }  # fmt: skip
    found = {}
    for name in where:
        if name not in joints:
            raise UnknownEffect(f"{kind} cannot act at {name!r}; joints are {', '.join(joints)}")
        j = joints.index(name)
        if kind == SCALE:
            found[_Column(0, j, scale=True)] = TorqueParameter(kind, name, "scale", "1", _SIZE)
            continue
        terms = first.columns.variants(j, kind)
        if not terms:
            raise UnknownEffect(
                f"{kind} cannot act at {name!r}; state its [robot.{EFFECTS[kind].needs}]"
            )
        term = (kind, FILE) if kind in LOSSES else terms[len(terms) // 2]
        places = first.columns.of(j, term).tolist()
        for at, (unknown, unit) in zip(places, EFFECTS[kind].unknowns, strict=False):
            power = np.mean([own.G[0, j, at, at] / own.counts[0, j] for own in parts])
            size = _SIZE * float(torque[j]) / max(float(power) ** 0.5, 1e-12)
            found[_Column(at, j)] = TorqueParameter(kind, name, unknown, unit, size)
    return found


def _unit(k: int) -> str:
    return "kg" if k == 0 else "kg m" if k < 4 else "kg m^2"


def _power(own: Products) -> Array:
    """Mean square of the nominal torque of each joint, shape (n,)."""
    G = own.G[0]
    total = np.einsum("jk,jkl,jl->j", own.nominal, G, own.nominal, optimize=True)
    return np.asarray(total / own.counts[0])


def _of_one(
    own: Products,
    columns: Sequence[_Column],
    named: Sequence[TorqueParameter],
    torque: Array,
    lasts: float,
) -> Array:
    """Information (p, p) of a motion, in plausible sizes."""
    M = np.zeros((len(columns), len(columns)))
    for j in range(own.robot.dof):
        D = np.zeros((own.columns.width, len(columns)))
        for k, (column, parameter) in enumerate(zip(columns, named, strict=True)):
            if column.joint not in (None, j):
                continue
            if column.scale:
                D[:, k] = own.nominal[j] * parameter.size
            else:
                D[column.at, k] = parameter.size
        samples = lasts / MEMORY / own.counts[0, j]
        M += samples / (RESIDUAL * torque[j]) ** 2 * (D.T @ own.G[0, j] @ D)
    return M


def _determined(M: Array, links: Array) -> IntArray:
    """Positions of independent parameters: terms of joints first, then base inertials by pivoting.

    links : ndarray of bool, shape (p,)
    """
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    left, kept = M / size[:, None] / size, list[int]()
    for group in (~links.astype(bool), links.astype(bool)):
        free = group.copy()
        while free.any():
            diagonal = np.where(free, np.diag(left), -np.inf)
            best = int(diagonal.argmax())
            if diagonal[best] < _OPEN**2 or size[best] <= 1e-140:
                break
            kept.append(best)
            free[best] = False
            left = left - np.outer(left[best], left[best]) / left[best, best]
    return np.sort(kept)
