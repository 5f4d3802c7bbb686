"""Better joint angles than any candidate's: a shrinking random search around each pose of a plan.

It needs no derivatives of the constraints and treats all poses in one batch; a pose moves only where
the plan gains and every constraint holds.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell.contacts import brought, touched
from doe.constraints import scene_of
from doe.problem import Problem
from doe.problem.pool import movable, rounded

_TRIES = 48  # neighbours of each pose in one round
_ROUNDS = 14
_WIDEST = 0.12  # of the joint range, shrinking to a two-hundredth of it
_NARROWEST = 6e-4


def polish(problem: Problem, q: Array, M: Array, *, seed: int) -> Array:
    """Move the poses of a plan inside the constraints, levels kept.

    q : ndarray, shape (N, dof); M : ndarray, shape (p, p), information of the plan
    Returns joint values; the criterion is never lower than before.
    """
    rng = np.random.default_rng(seed)
    robot, levels = problem.cell.robot, problem.request.levels
    low, high = robot.sample_limits().T
    free, contacts = movable(problem.cell, levels), touched(problem.cell, q)
    q, blocks = q.copy(), problem.information(q)
    value = float(problem.criterion.value(M))
    for width in np.geomspace(_WIDEST, _NARROWEST, _ROUNDS):
        steps = rng.normal(size=(len(q), _TRIES, robot.dof)) * width * (high - low) * free
        # Half of the tries move one joint alone: most gains lie along single axes.
        lone = np.eye(robot.dof)[rng.integers(robot.dof, size=(len(q), _TRIES // 2))]
        steps[:, : _TRIES // 2] *= lone
        tries = rounded(
            problem.cell, np.clip(q[:, None, :] + steps, low, high).reshape(-1, robot.dof)
        )
        if levels is not None:
            tries[:, levels.joint] = np.repeat(q[:, levels.joint], _TRIES)
        tries = brought(problem.cell, robot.tied(tries), np.repeat(contacts, _TRIES), free)
        kept, found, owner = _feasible(problem, tries)
        for slot in range(len(q)):
            own = np.flatnonzero(owner == slot)
            if not len(own):
                continue
            base = M - blocks[slot]
            values = problem.criterion.value(base + found[own])
            best = int(values.argmax())
            if values[best] > value:
                value = float(values[best])
                q[slot], blocks[slot] = kept[own[best]], found[own[best]]
                M = base + blocks[slot]
    return q


def _feasible(problem: Problem, tries: Array) -> tuple[Array, Array, IntArray]:
    """Tries that satisfy the constraints, their information, and the pose each belongs to."""
    numbered = np.arange(len(tries))
    for constraint in problem.constraints:
        if len(numbered):
            allowed = constraint.allows(scene_of(problem.cell, tries[numbered]))
            numbered = numbered[allowed]
    kept = tries[numbered]
    blocks = problem.information(kept) if len(kept) else np.zeros((0, *problem.fixed.shape))
    return kept, np.asarray(blocks), numbered // _TRIES
