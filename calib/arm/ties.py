"""Joints that others move, ``q = sum factor * q_other + offset``, and which are left to choose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array


@dataclass(frozen=True)
class Coupling:
    """A joint without a drive that others of the robot move, as a rod keeps a link level.

    joint : str
    factors : tuple of (str, float), joints that move it, rad or m by rad or m; offset : float, rad or m
    """

    joint: str
    factors: tuple[tuple[str, float], ...]
    offset: float


@dataclass(frozen=True, eq=False)
class Ties:
    """What n joints are by those among them that may be chosen freely, ``q = matrix @ q + shift``.

    matrix : ndarray, shape (n, n), with columns of zeros for joints that follow
    shift : ndarray, shape (n,), rad or m
    """

    matrix: Array
    shift: Array


def ties_of(joints: Sequence[str], couplings: Sequence[Coupling]) -> Ties:
    """Ties of a robot."""
    matrix, shift = np.eye(len(joints)), np.zeros(len(joints))
    place = {name: k for k, name in enumerate(joints)}
    for coupling in couplings:
        k = place[coupling.joint]
        matrix[k], shift[k] = 0.0, coupling.offset
        matrix[k, [place[name] for name, _ in coupling.factors]] = [f for _, f in coupling.factors]
    while not np.array_equal(further := matrix @ matrix, matrix):  # followers that others follow
        matrix, shift = further, matrix @ shift + shift
    return Ties(matrix, shift)


def moves_itself(couplings: Sequence[Coupling]) -> str:
    """The first joint that moves itself, also by way of others; empty where none does."""
    movers = {own.joint: [name for name, _ in own.factors] for own in couplings}
    for joint in movers:
        above = [*movers[joint]]
        for name in above:  # grows
            above += [other for other in movers.get(name, ()) if other not in above]
        if joint in above:
            return joint
    return ""


def reachable(ties: Ties, limits: Array) -> Array:
    """Limits (n, 2) in which a joint that leads keeps those that follow it alone within theirs, too."""
    found = limits.copy()
    for k, row in enumerate(ties.matrix):
        lead = int(np.abs(row).argmax())
        if lead != k and np.count_nonzero(row) == 1:
            own = np.sort((limits[k] - ties.shift[k]) / row[lead])
            found[lead] = max(found[lead, 0], own[0]), min(found[lead, 1], own[1])
    return found
